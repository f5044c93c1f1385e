// Files that the command line tool reads and writes, some of which hold secrets.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"

namespace myograde::server {

// InvalidArgumentError with `path`, the reason in errno and what to do.
absl::Status CantWrite(const std::string& path);

// A file that appears under its name only when it is whole and on the disk: it is a new one even if
// another file has its name already. A device or a pipe of that name is written to as it is.
class NewFile {
 public:
  // Nobody but its owner can read it at any time, if `mode` does not say otherwise.
  explicit NewFile(std::string path, mode_t mode = 0600);
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;
  ~NewFile();  // removes a file that was not kept

  // CantWrite, if it can't be opened or a Write failed.
  const absl::Status& status() const { return status_; }
  absl::Status Write(std::string_view text);
  // Gives the file its name, in place of what had it; the digest of what was written.
  absl::StatusOr<std::string> Keep();

 private:
  const std::string path_;
  const bool in_place_;  // it is not a file
  const std::string part_;
  Fd fd_;
  Sha256 hash_;
  absl::Status status_;
};

// Writes a whole NewFile; the digest of `content`. InvalidArgumentError if it can't be written.
absl::StatusOr<std::string> WriteNewFile(const std::string& path, std::string_view content,
                                         mode_t mode = 0600);

// Creates `folder` and those above it, if missing. InvalidArgumentError with the reason, followed by
// `todo`.
absl::Status MakeFolders(const std::string& folder, const std::string& todo = "");

// The same, and it has nothing in it.
absl::Status MakeEmptyFolder(const std::string& folder, const std::string& todo = "");

// Reads a seed list: whole numbers from 0 to 2^63-1 without repetition, 1 to 10,000 of them, in
// JSON as ParseSeeds takes them or one a line ('#' begins a comment). InvalidArgumentError names
// the file and the line or entry.
absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path);

}  // namespace myograde::server
