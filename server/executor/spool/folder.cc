#include "server/executor/spool/folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr int kFolderFlags = O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC;
// A pipe under a file's name must not make its opener wait.
constexpr int kReadFlags = O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
constexpr size_t kPieceBytes = 256u << 10;

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

// The name of an unfinished file: unlike that of any other process of any host, and never one that
// anybody reads.
std::string DraftName(const std::string& name) {
  static std::atomic<uint64_t> count = 0;
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return absl::StrCat(".draft-", name.substr(0, 100), "-", gethostid(), "-", getpid(), "-",
                      now.tv_nsec, "-", count.fetch_add(1));
}

absl::StatusOr<Fd> OpenRegular(int folder, const std::string& name, const std::string& path,
                               int flags) {
  Fd file(openat(folder, name.c_str(), flags, 0600));
  if (!file.valid()) return DiskError(path, "opened");
  struct stat info;
  if (fstat(file.get(), &info) != 0) return DiskError(path, "examined");
  if (!S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": is no regular file"));
  }
  return file;
}

absl::Status Sync(int file, const std::string& path) {
  return fsync(file) == 0 ? absl::OkStatus() : DiskError(path, "written to the disk");
}

absl::Status WritePiece(int file, const char* bytes, size_t size, const std::string& path) {
  while (size > 0) {
    const ssize_t n = write(file, bytes, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return DiskError(path, "written");
    bytes += n;
    size -= static_cast<size_t>(n);
  }
  return absl::OkStatus();
}

absl::Status Copy(const ByteSource& source, int file, int64_t most, const std::string& path) {
  std::vector<char> piece(kPieceBytes);
  int64_t copied = 0;
  while (true) {
    const ssize_t n = source(piece.data(), piece.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return DiskError(path, "copied from its source");
    if (n == 0) return absl::OkStatus();
    copied += n;
    if (copied > most) {
      return absl::InvalidArgumentError(absl::StrCat(path, ": has more than ", most, " bytes"));
    }
    RETURN_IF_ERROR(WritePiece(file, piece.data(), static_cast<size_t>(n), path));
  }
}

}  // namespace

ByteSource BytesOf(int fd) {
  return [fd](char* to, size_t size) { return read(fd, to, size); };
}

absl::Status DiskError(const std::string& path, std::string_view done) {
  const int error = errno;
  const std::string text = absl::StrCat(path, ": can't be ", View(done), ": ",
                                        std::strerror(error));
  switch (error) {
    case ENOENT: return absl::NotFoundError(text);
    case EEXIST: return absl::AlreadyExistsError(text);
    case ENOSPC:
    case EDQUOT: return absl::ResourceExhaustedError(text);
    case ELOOP:
    case ENOTDIR:
    case EISDIR: return absl::InvalidArgumentError(text);
    default: return absl::UnavailableError(text);
  }
}

absl::StatusOr<Folder> Folder::Open(const std::string& path) {
  Fd fd(open(path.c_str(), kFolderFlags));
  if (!fd.valid()) return DiskError(path, "opened");
  return Folder(path, std::move(fd));
}

absl::StatusOr<Folder> Folder::Make(const std::string& path) {
  if (mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) return DiskError(path, "made");
  return Open(path);
}

absl::Status Folder::CheckPrivate() const {
  struct stat info = {};
  if (fstat(fd_.get(), &info) != 0) return DiskError(path_, "looked at");
  if ((info.st_mode & (S_IWGRP | S_IWOTH)) == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(path_, ": other users may write to it (mode ", absl::StrFormat("%04o", info.st_mode & 07777), "), so they could ",
                   "forge results; empty it, and chmod 700 it"));
}

absl::StatusOr<Folder> Folder::OpenFolder(const std::string& name) const {
  Fd fd(openat(fd_.get(), name.c_str(), kFolderFlags));
  if (!fd.valid()) return DiskError(PathOf(name), "opened");
  return Folder(PathOf(name), std::move(fd));
}

absl::StatusOr<Folder> Folder::MakeFolder(const std::string& name) const {
  if (mkdirat(fd_.get(), name.c_str(), 0700) != 0 && errno != EEXIST) {
    return DiskError(PathOf(name), "made");
  }
  return OpenFolder(name);
}

absl::StatusOr<Folder> Folder::MakeNewFolder(const std::string& name) const {
  if (mkdirat(fd_.get(), name.c_str(), 0700) != 0) return DiskError(PathOf(name), "made");
  return OpenFolder(name);
}

absl::StatusOr<Fd> Folder::OpenFile(const std::string& name) const {
  return OpenRegular(fd_.get(), name, PathOf(name), kReadFlags);
}

absl::StatusOr<std::string> Folder::Read(const std::string& name, size_t most) const {
  ASSIGN_OR_RETURN(Fd file, OpenFile(name));
  return ReadAll(file.get(), PathOf(name), most);
}

absl::StatusOr<std::string> Folder::ReadAt(const std::string& name, int64_t offset,
                                           size_t most) const {
  ASSIGN_OR_RETURN(Fd file, OpenFile(name));
  struct stat info;
  if (fstat(file.get(), &info) != 0) return DiskError(PathOf(name), "examined");
  if (offset >= info.st_size) return std::string();
  std::string bytes(std::min(most, static_cast<size_t>(info.st_size - offset)), '\0');
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = pread(file.get(), bytes.data() + done, bytes.size() - done,
                            offset + static_cast<int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return DiskError(PathOf(name), "read");
    if (n == 0) break;
    done += static_cast<size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

absl::StatusOr<int64_t> Folder::SizeOf(const std::string& name) const {
  ASSIGN_OR_RETURN(Fd file, OpenFile(name));
  struct stat info;
  if (fstat(file.get(), &info) != 0) return DiskError(PathOf(name), "examined");
  return static_cast<int64_t>(info.st_size);
}

absl::StatusOr<bool> Folder::Has(const std::string& name) const {
  struct stat info;
  if (fstatat(fd_.get(), name.c_str(), &info, AT_SYMLINK_NOFOLLOW) == 0) return true;
  if (errno == ENOENT) return false;
  return DiskError(PathOf(name), "examined");
}

absl::StatusOr<std::vector<std::string>> Folder::Names(size_t most) const {
  // A descriptor of its own: the place in the list belongs to it.
  Fd fd(openat(fd_.get(), ".", kFolderFlags));
  if (!fd.valid()) return DiskError(path_, "listed");
  DIR* entries = fdopendir(fd.get());
  if (entries == nullptr) return DiskError(path_, "listed");
  (void)fd.release();
  std::vector<std::string> names;
  errno = 0;
  while (const dirent* entry = readdir(entries)) {
    const std::string_view name = entry->d_name;
    if (name != "." && name != ".." && names.size() < most) names.emplace_back(name);
    errno = 0;
  }
  const absl::Status status = errno == 0 ? absl::OkStatus() : DiskError(path_, "listed");
  closedir(entries);
  if (!status.ok()) return status;
  std::sort(names.begin(), names.end());
  return names;
}

absl::Status Folder::PutDraft(const std::string& name, const Write& write,
                              const Place& place) const {
  const std::string draft = DraftName(name);
  ASSIGN_OR_RETURN(Fd file,
                   OpenRegular(fd_.get(), draft, PathOf(name),
                               O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC));
  absl::Status status = write(file.get());
  if (status.ok()) status = Sync(file.get(), PathOf(name));
  if (status.ok()) status = place(file.get(), draft);
  if (status.ok()) return Sync(fd_.get(), path_);
  unlinkat(fd_.get(), draft.c_str(), 0);
  return status;
}

absl::Status Folder::Replace(const std::string& draft, const std::string& name) const {
  return renameat(fd_.get(), draft.c_str(), fd_.get(), name.c_str()) == 0
             ? absl::OkStatus()
             : DiskError(PathOf(name), "put in place");
}

absl::Status Folder::Put(const std::string& name, std::string_view text) const {
  return PutDraft(
      name, [&](int file) { return WritePiece(file, text.data(), text.size(), PathOf(name)); },
      [&](int, const std::string& draft) { return Replace(draft, name); });
}

absl::Status Folder::PutFrom(const std::string& name, const ByteSource& source,
                             int64_t most) const {
  return PutDraft(
      name, [&](int file) { return Copy(source, file, most, PathOf(name)); },
      [&](int, const std::string& draft) { return Replace(draft, name); });
}

absl::Status Folder::PutNew(const std::string& name, std::string_view text) const {
  return PutDraft(
      name, [&](int file) { return WritePiece(file, text.data(), text.size(), PathOf(name)); },
      [&](int file, const std::string& draft) {
        // A link never replaces, and shows the whole text at once. On a network's disk the answer
        // may be lost, and a second try be refused because of the first: the count of links tells.
        absl::Status status;
        if (linkat(fd_.get(), draft.c_str(), fd_.get(), name.c_str(), 0) != 0) {
          status = DiskError(PathOf(name), "put in place");
          struct stat info;
          if (fstat(file, &info) == 0 && info.st_nlink == 2) status = absl::OkStatus();
        }
        if (status.ok()) unlinkat(fd_.get(), draft.c_str(), 0);
        return status;
      });
}

absl::Status Folder::WriteAt(const std::string& name, int64_t offset,
                             std::string_view bytes) const {
  ASSIGN_OR_RETURN(Fd file,
                   OpenRegular(fd_.get(), name, PathOf(name),
                               O_WRONLY | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (lseek(file.get(), offset, SEEK_SET) < 0) return DiskError(PathOf(name), "written");
  absl::Status status = WritePiece(file.get(), bytes.data(), bytes.size(), PathOf(name));
  return status.ok() ? Sync(file.get(), PathOf(name)) : status;
}

absl::StatusOr<Fd> Folder::Lock(const std::string& name) const {
  Fd fd(openat(fd_.get(), name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!fd.valid()) return DiskError(PathOf(name), "opened");
  if (flock(fd.get(), LOCK_EX | LOCK_NB) == 0) return fd;
  if (errno == EWOULDBLOCK) {
    return absl::AlreadyExistsError(absl::StrCat(PathOf(name), ": is locked by another process"));
  }
  // Not every network's disk has locks.
  if (errno == ENOLCK || errno == ENOSYS || errno == EOPNOTSUPP) return Fd();
  return DiskError(PathOf(name), "locked");
}

absl::Status Folder::Remove(const std::string& name) const {
  if (unlinkat(fd_.get(), name.c_str(), 0) == 0 || errno == ENOENT) return absl::OkStatus();
  return DiskError(PathOf(name), "removed");
}

absl::Status Folder::RemoveFolder(const std::string& name) const {
  absl::StatusOr<Folder> folder = OpenFolder(name);
  if (absl::IsNotFound(folder.status())) return absl::OkStatus();
  if (!folder.ok()) return folder.status();
  ASSIGN_OR_RETURN(const std::vector<std::string> names, folder->Names(SIZE_MAX));
  for (const std::string& inner : names) {
    struct stat info;
    const bool is_folder = fstatat(folder->fd_.get(), inner.c_str(), &info,
                                   AT_SYMLINK_NOFOLLOW) == 0 &&
                           S_ISDIR(info.st_mode);
    RETURN_IF_ERROR(is_folder ? folder->RemoveFolder(inner) : folder->Remove(inner));
  }
  if (unlinkat(fd_.get(), name.c_str(), AT_REMOVEDIR) == 0 || errno == ENOENT) {
    return absl::OkStatus();
  }
  return DiskError(PathOf(name), "removed");
}

absl::StatusOr<bool> Folder::IsStill(const Folder& parent, const std::string& name) const {
  struct stat mine;
  struct stat there;
  if (fstat(fd_.get(), &mine) != 0) {
    if (errno == ENOENT || errno == ESTALE) return false;
    return DiskError(path_, "examined");
  }
  if (fstatat(parent.fd_.get(), name.c_str(), &there, AT_SYMLINK_NOFOLLOW) != 0) {
    if (errno == ENOENT) return false;
    return DiskError(path_, "examined");
  }
  return mine.st_dev == there.st_dev && mine.st_ino == there.st_ino;
}

}  // namespace myograde::server
