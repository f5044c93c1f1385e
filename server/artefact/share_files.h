// Keeps files that several unpacked images have in common once on the disk.
//
// The pool is a folder of the daemon in which each file is named by its SHA-256, mode and time. An
// image's files are hard links to those of the pool. Content is compared by the hash of the bytes
// that lie there, never by one that the process for unpacking reports: if that process was taken
// over, it could pass off one file as another, for other teams' images too. Everything is opened
// below a descriptor and through no link. Policies see the files through read-only mounts.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>

namespace myograde::server {

// Shares the files of the image in the artefact's folder `artefact`, and does nothing if it has none.
// Nothing may use it yet. Both folders are on one file system; the pool is made if it is missing. A
// file that can't be shared stays as it is.
absl::Status ShareImage(const std::string& artefact, const std::string& pool);

// Removes what no image uses any more from the pool; the number of bytes that this frees. Safe while
// others share.
int64_t SweepPool(const std::string& pool);

// The bytes that an artefact's files take on the disk: a file that n artefacts share counts as an
// n-th of its size for each.
int64_t DiskBytes(const std::string& artefact);

}  // namespace myograde::server
