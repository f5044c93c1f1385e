// Opens, makes and lists files below a folder that a participant filled, without following links.
#pragma once

#include <sys/types.h>

#include <climits>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/artefact/listing.h"

namespace myograde::server {

// Makes a folder, which must not be there yet, to be filled below the descriptor; after an error
// there is none. An error of HostError.
absl::StatusOr<Fd> MakeFolderToFill(const std::string& path);

// Opens `path` (relative, without ".." or empty names) below the folder `root`, like openat(2) with
// O_CLOEXEC and O_NOFOLLOW. A symbolic link anywhere in the path, or an escape from the folder, is
// ELOOP or EXDEV; with O_PATH a link as the last name is itself opened. Returns an invalid Fd and
// sets errno on failure.
Fd OpenBeneath(int root, const std::string& path, int flags, mode_t mode = 0);

// The same for the folder that holds `path`, with O_PATH; an error of HostError.
absl::StatusOr<Fd> OpenFolderOf(int root, const std::string& path);

// The parts of a path, "" for the top folder, and a name in a folder.
std::string FolderName(const std::string& path);
std::string LastName(const std::string& path);
std::string Joined(const std::string& folder, const std::string& name);

// The names in a folder, sorted, without "." and ".."; nullopt: errno says why it can't be read.
std::optional<std::vector<std::string>> NamesIn(int folder);

// The target of a link that was opened with O_PATH; "": it can't be read.
std::string TargetOf(int link);

// Each makes what must not be there yet at a clean path, in a folder that is. Folders and files get
// the modes of submissions, 0755 or 0644, whatever the umask is. Errors of HostError.
absl::Status MakeFolderBeneath(int root, const std::string& path);
absl::Status MakeLinkBeneath(int root, const std::string& path, const std::string& target);
// `next` yields the content until it yields nothing. The file gets the time of `entry`, whose size
// and digest are filled in.
absl::Status MakeFileBeneath(int root, const std::string& path, Entry& entry,
                             const std::function<absl::StatusOr<std::string_view>()>& next);

// Whose folder or archive it is.
enum class FolderOf {
  kParticipant,  // what breaks a rule of submissions is an InvalidArgumentError that says what to
                 // do
  kDaemon,       // a submission that was accepted; what can't be in one is a DataLossError
};

// What the daemon has accepted is not judged again; the depth alone is bounded, by what it can have
// accepted, as folders are walked by recursion. (An image's files are one folder deeper.)
inline constexpr ArtefactLimits kNoLimits = {
    .bytes = int64_t{1} << 60, .files = int64_t{1} << 40, .depth = 200, .name_bytes = NAME_MAX};

// Adds the entries below `folder` of `root`, a descriptor, to `listing`; of files, all but the
// SHA-256. "" is the top. The listing's limit bounds the depth.
absl::Status ListFolder(int root, FolderOf whose, Listing& listing, const std::string& folder = "");

// The error for an entry that errno says can't be read.
absl::Status Unreadable(const std::string& path, FolderOf whose);

}  // namespace myograde::server
