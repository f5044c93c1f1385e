// Files in folders that several hosts share, relative to an open descriptor. No name is followed
// through a link, nothing that is read is larger than its caller says, and nothing here waits but
// for the disk; a network's disk can take long, or for ever.
//
// Errors, of all functions: NotFoundError: it is not there. ResourceExhaustedError: the disk or the
// quota is full. InvalidArgumentError: something else is there under that name, or it is too large.
// UnavailableError: all other trouble with the disk; trying again can help.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// Yields bytes: as read(2), at most `size` to `to`, 0 at the end, negative with errno set. Trying
// again yields the same bytes from the start only where its maker says so.
using ByteSource = std::function<ssize_t(char* to, size_t size)>;

// The rest of a descriptor's content, from where it stands. The descriptor must outlive it.
ByteSource BytesOf(int fd);

// The error for `errno` at `path`: "PATH: can't be DONE: reason".
absl::Status DiskError(const std::string& path, std::string_view done);

class Folder {
 public:
  Folder() = default;
  // An existing folder; its last component must not be a link.
  static absl::StatusOr<Folder> Open(const std::string& path);
  // As Open; makes it (0700) if it is not there, but none above it.
  static absl::StatusOr<Folder> Make(const std::string& path);

  // The same, of a folder in this one.
  absl::StatusOr<Folder> OpenFolder(const std::string& name) const;
  absl::StatusOr<Folder> MakeFolder(const std::string& name) const;
  // As MakeFolder; AlreadyExistsError if it is there.
  absl::StatusOr<Folder> MakeNewFolder(const std::string& name) const;

  // The content of a file of at most `most` bytes.
  absl::StatusOr<std::string> Read(const std::string& name, size_t most) const;
  // Up to `most` bytes of a file from `offset` on; fewer, or none, at its end. Opens it anew, so
  // that what another host has written and synced is seen.
  absl::StatusOr<std::string> ReadAt(const std::string& name, int64_t offset, size_t most) const;
  // A file's size.
  absl::StatusOr<int64_t> SizeOf(const std::string& name) const;
  // To read a regular file.
  absl::StatusOr<Fd> OpenFile(const std::string& name) const;
  // False: there is nothing under that name.
  absl::StatusOr<bool> Has(const std::string& name) const;
  // The names in it, sorted; of at most `most`, any.
  absl::StatusOr<std::vector<std::string>> Names(size_t most) const;

  // Puts a file (0600) in place as a whole, on disk on return, whatever was there before.
  absl::Status Put(const std::string& name, std::string_view text) const;
  // The same with all of `source`, up to `most` bytes (InvalidArgumentError if there is more).
  absl::Status PutFrom(const std::string& name, const ByteSource& source, int64_t most) const;
  // As Put, unless there is something: AlreadyExistsError. Of several hosts, one succeeds.
  absl::Status PutNew(const std::string& name, std::string_view text) const;
  // Writes at a place of a file (0600), which is made if it is not there; on disk on return. After
  // an error any part of it may have been written, and it can be tried again.
  absl::Status WriteAt(const std::string& name, int64_t offset, std::string_view bytes) const;

  // Makes a file (0600) if it is not there, and locks it until the descriptor is closed.
  // AlreadyExistsError: another process has it. An invalid descriptor: the disk knows no locks.
  absl::StatusOr<Fd> Lock(const std::string& name) const;

  // Removes a file; fine if there is none.
  absl::Status Remove(const std::string& name) const;
  // Removes a folder with all that is in it; fine if there is none.
  absl::Status RemoveFolder(const std::string& name) const;

  // FailedPreconditionError: other users than its owner may write to it.
  absl::Status CheckPrivate() const;

  const std::string& path() const { return path_; }  // as it was opened, for messages
  // Whether that folder is still there under `name` of `parent`.
  absl::StatusOr<bool> IsStill(const Folder& parent, const std::string& name) const;

 private:
  Folder(std::string path, Fd fd) : path_(std::move(path)), fd_(std::move(fd)) {}
  std::string PathOf(const std::string& name) const { return path_ + "/" + name; }

  // Writes a draft by `write`, syncs it, and has `place` give it its name; then it is no more. Neither
  // leaves a draft after an error.
  using Write = std::function<absl::Status(int file)>;
  using Place = std::function<absl::Status(int file, const std::string& draft)>;
  absl::Status PutDraft(const std::string& name, const Write& write, const Place& place) const;
  absl::Status Replace(const std::string& draft, const std::string& name) const;

  std::string path_;
  Fd fd_;
};

}  // namespace myograde::server
