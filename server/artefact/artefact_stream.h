// Carries a submission's files from the daemon to a node: its unpacked folder (server/artefact) as a
// tar, and the tar as the same folder again. Names, targets of links and contents are a
// participant's, and are only ever data: every file is opened beneath the folder and through no link,
// on both sides. What comes out has the digest that identifies the submission, or nothing does.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct PackedFolder {
  std::string sha256;  // of the tar
  int64_t bytes = 0;   // of the tar
};

// Packs a folder into `archive`, a descriptor of an empty file for reading and writing. The same
// folder gives the same bytes. `digest` is that of the artefact: DataLossError if the folder's
// content has another. ResourceExhaustedError: the disk is full. UnavailableError: other trouble of
// the host. `progress` receives the bytes of the files packed so far, often.
absl::StatusOr<PackedFolder> PackArtefactFolder(const std::string& folder,
                                                const std::string& digest, int archive,
                                                const ByteProgress& progress = nullptr);

// The reverse, into `folder`, which must not exist and is removed again after an error. Files and
// folders get the modes that the daemon gives them (0755 and 0644) and their times; they belong to
// the caller. `archive` must be exactly the file that `packed` describes, which is checked before
// anything is made of it: DataLossError otherwise, and if the content has another digest.
absl::Status UnpackArtefactFolder(int archive, const PackedFolder& packed,
                                  const std::string& digest, const std::string& folder);

}  // namespace myograde::server
