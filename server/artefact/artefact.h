// Submissions as files: what a participant hands in, checked and turned into a
// folder whose identity is a digest. See README.md for the rules.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// What a submission may hold. Every number is enforced; none may be below 1.
struct ArtefactLimits {
  int64_t bytes = int64_t{4} << 30;  // of all files together, unpacked
  int64_t files = 200'000;           // files, folders and links together
  int64_t depth = 64;                // names in a path
  int64_t name_bytes = 255;          // of one name
};

// What policy.json says.
struct ArtefactManifest {
  std::string name;                   // for people; 1 to 64 bytes
  // command[0] is absolute, or inside with a slash in it, or a word to be looked up on the PATH.
  std::vector<std::string> command;
  std::vector<std::string> runtimes;  // names of the server's runtimes that it needs
  std::map<std::string, std::string> environment;  // variables that the policy finds set
};

struct Artefact {
  std::string digest;  // SHA-256 (hex) of the canonical listing: the artefact's identity
  ArtefactManifest manifest;
  int64_t bytes = 0;  // of all files
  int64_t files = 0;  // files, folders and links
};

// Hears now and then how many bytes are done, of how many.
using ByteProgress = std::function<void(int64_t done, int64_t total)>;

// Writes what a participant has at `path` to the file `archive` (made or
// replaced) as a canonical tar: entries sorted, no owners, modes 0755 or 0644,
// times of files in whole seconds and no others. `path` is a folder with policy.json at its top, a
// single executable file (a manifest that runs it is added), or an archive (.tar, .tar.gz, .tgz,
// .tar.zst, .zip). The same rules hold as in UnpackArtefact, so most mistakes
// are told before anything is sent. InvalidArgumentError: `path` breaks a rule
// (NotFoundError: isn't there); other codes: this host is in trouble.
absl::Status PackArtefact(const std::string& path, const std::string& archive,
                          const ArtefactLimits& limits, const ByteProgress& progress = nullptr);

// Unpacks an archive that nobody vouches for into `destination`, which must not
// exist and is removed again after an error. Links are kept as links and never
// followed. Nothing is synced to disk: a caller that needs that calls syncfs.
// InvalidArgumentError: the archive breaks a rule, with the entry and the rule;
// other codes: this host is in trouble (no space, no right to write).
// `progress` hears the bytes read of the archive.
absl::StatusOr<Artefact> UnpackArtefact(const std::string& archive, const std::string& destination,
                                        const ArtefactLimits& limits,
                                        const ByteProgress& progress = nullptr);

// The two halves of UnpackArtefact, for a process that gives up its rights between
// them. The first makes `destination` and opens all that the second needs, which
// opens nothing but below the folder and leaves there what it made before an error;
// after an error of the first there is no folder.
struct UnpackPlace {
  Fd archive;
  Fd folder;
};
absl::StatusOr<UnpackPlace> OpenUnpackPlace(const std::string& archive,
                                            const std::string& destination);
absl::StatusOr<Artefact> UnpackOpened(int archive, int folder, const ArtefactLimits& limits,
                                      const ByteProgress& progress = nullptr);

// Reads and checks policy.json of an unpacked artefact: strict keys, and a
// command that is there and can be run. What the command means outside the artefact
// is not looked at (server/sandbox/program.h). InvalidArgumentError otherwise.
// `folder`: its path, or a descriptor.
absl::StatusOr<ArtefactManifest> ReadManifest(const std::string& folder);
absl::StatusOr<ArtefactManifest> ReadManifest(int folder);

}  // namespace myograde::server
