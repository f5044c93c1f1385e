// An artefact's content as a list, the rules for every entry, whether from an archive or from a
// folder, and the files below a folder that a participant filled: they are opened, made and listed
// without following links.
#pragma once

#include <sys/types.h>

#include <climits>
#include <cstdint>
#include <functional>
#include <locale>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/artefact/artefact.h"

namespace myograde::server {

enum class EntryType { kFile, kFolder, kLink };

struct Entry {
  EntryType type = EntryType::kFile;
  bool stated = false;      // listed in the archive itself, not only implied by an entry below it
  bool executable = false;  // files only
  int64_t size = 0;         // files only
  int64_t time = 0;         // files only; from KeptTime, not part of the digest
  std::string sha256 = {};  // files only; hex
  std::string target = {};  // links only
};

class Listing {
 public:
  explicit Listing(const ArtefactLimits& limits) : limits_(limits) {}

  // The path in the listing's form: no leading "./", no doubled or trailing slash; "" for the top
  // folder. An error if it is absolute, has "..", control characters or invalid UTF-8, or breaks a
  // limit.
  absl::StatusOr<std::string> CleanPath(std::string_view path) const;

  // Adds an entry at a clean path, and its parent folders. An error if it exists already, is below
  // something that is not a folder, or breaks a limit.
  absl::StatusOr<Entry*> Add(const std::string& path, EntryType type);

  // AddBytes counts `bytes` more of file content; CheckRoom only checks whether they would fit.
  absl::Status AddBytes(const std::string& path, int64_t bytes);
  absl::Status CheckRoom(const std::string& path, int64_t bytes) const;

  // An entry that is there, to be completed.
  Entry& at(const std::string& path) { return entries_.at(path); }

  // The error for an archive with too many entries.
  absl::Status TooManyEntries(std::string_view where) const;

  // SHA-256 over one canonical line per entry, sorted by path.
  std::string Digest() const;

  // By path, sorted bytewise. Folders come before their content.
  const std::map<std::string, Entry>& entries() const { return entries_; }
  int64_t bytes() const { return bytes_; }

 private:
  const ArtefactLimits limits_;
  std::map<std::string, Entry> entries_;
  int64_t bytes_ = 0;
};

// A file's time as it is kept, in seconds since 1970-01-01 UTC: clamped to 32 bits, which every
// file system can store and which are all that Python compares for compiled modules.
int64_t KeptTime(int64_t seconds);

// An error if the target of a symbolic link has "..", is empty or not UTF-8.
absl::Status CheckLinkTarget(std::string_view path, std::string_view target);

// An error if the text of a symbolic link is empty or not plain UTF-8.
absl::Status CheckLinkText(std::string_view path, std::string_view target);

// A path for a message: quoted, shortened, and without bytes that could affect a terminal.
std::string Quoted(std::string_view path);

// "what: reason of errno", with a code that blames the host.
absl::Status HostError(std::string_view what);

// libarchive converts names by the calling thread's locale; while this object lives, that is UTF-8,
// whatever the environment says.
class Utf8Names {
 public:
  Utf8Names();
  ~Utf8Names();
  Utf8Names(const Utf8Names&) = delete;
  Utf8Names& operator=(const Utf8Names&) = delete;

 private:
  locale_t utf8_;
  locale_t before_;
};

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
