// Submissions as files: checks what a participant submits and turns it into a folder that is
// identified by a digest. The rules are in README.md.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/lease/policy_image.h"

namespace myograde::server {

// Limits of a submission. All are enforced; REQUIRES: each is at least 1.
struct ArtefactLimits {
  int64_t bytes = int64_t{4} << 30;  // total of all files, unpacked
  int64_t files = 200'000;           // files, folders and links together
  int64_t depth = 64;                // names in a path
  int64_t name_bytes = 255;          // of one name
};

struct Artefact {
  std::string digest;  // SHA-256 (hex) of the canonical listing; identifies the artefact
  PolicyManifest manifest;
  int64_t bytes = 0;  // of all files
  int64_t files = 0;  // files, folders and links
};

// Called from time to time with the bytes done and the total.
using ByteProgress = std::function<void(int64_t done, int64_t total)>;

// Packs what a participant has at `path` (README.md) into the file `archive`, created or replaced,
// as a canonical tar: sorted entries, no owners, modes 0755 or 0644, file times in whole seconds and
// no other times. `name` is written into the packed policy.json in place of the name there; "":
// that one stays, and an image has the name that it was saved by, or its file's. Enforces the rules
// of UnpackArtefact, so that most mistakes are reported before anything is sent; of an image, which
// is packed as it is, it reads no more than its name. Returns what the packed policy.json says: an
// image's own command is not in it.
// InvalidArgumentError: `path` or `name` breaks a rule (NotFoundError: `path` doesn't exist); other
// codes: a problem of this host.
absl::StatusOr<PolicyManifest> PackArtefact(const std::string& path, const std::string& archive,
                                            const ArtefactLimits& limits,
                                            const ByteProgress& progress = nullptr,
                                            const std::string& name = "");

// Unpacks an untrusted archive into `destination`, which must not exist and is removed again after
// an error. Links are kept as links and never followed. Nothing is synced to disk: call syncfs if
// you need that. InvalidArgumentError: the archive breaks a rule, with the entry and the rule;
// other codes: a problem of this host (no space, no permission). `progress` receives the number of
// archive bytes read.
absl::StatusOr<Artefact> UnpackArtefact(const std::string& archive, const std::string& destination,
                                        const ArtefactLimits& limits,
                                        const ByteProgress& progress = nullptr);

// The two halves of UnpackArtefact, for a process that drops its privileges between them. The first
// creates `destination` and opens everything that the second needs; after an error there is no
// folder. The second opens nothing outside the folder, and after an error leaves what it has
// written there.
struct UnpackPlace {
  Fd archive;
  Fd folder;
};
absl::StatusOr<UnpackPlace> OpenUnpackPlace(const std::string& archive,
                                            const std::string& destination);
absl::StatusOr<Artefact> UnpackOpened(int archive, int folder, const ArtefactLimits& limits,
                                      const ByteProgress& progress = nullptr);

// The next two carry an accepted submission's files to another host: its unpacked folder as a tar,
// and the tar as the same folder again. Names, targets of links and contents are a participant's,
// and are only ever data: every file is opened beneath the folder and through no link, on both
// sides. What comes out has the digest that identifies the submission, or nothing does.

using ByteSink = std::function<absl::Status(std::string_view bytes)>;
// The next bytes; "": there are no more.
using ByteSource = std::function<absl::StatusOr<std::string>()>;

// Gives the folder's tar to `sink`; the same folder gives the same bytes. `digest` is that of the
// artefact: DataLossError, once all bytes were given, if the folder's content has another. Else an
// error of the sink's, or UnavailableError: trouble of the host.
absl::Status StreamArtefact(const std::string& folder, const std::string& digest,
                            const ByteSink& sink);

// The reverse, into `folder`, which must not exist and is removed again after an error. Files and
// folders get the modes that the daemon gives them (0755 and 0644) and their times; they belong to
// the caller. DataLossError: it is broken, or the content has another digest.
// ResourceExhaustedError: the disk is full. Else an error of the source's, or UnavailableError:
// trouble of the host.
absl::Status PlaceStreamedArtefact(const ByteSource& source, const std::string& digest,
                                   const std::string& folder);

}  // namespace myograde::server
