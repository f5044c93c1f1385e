#include "server/base/data_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <cerrno>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"

namespace myograde::server {
namespace {

// The process id that the holder wrote to the file; "unknown" if it has not done so yet.
std::string ReadHolder(const std::string& path) {
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  char text[32] = {};
  const ssize_t n = file.valid() ? pread(file.get(), text, sizeof(text) - 1, 0) : 0;
  std::string pid;
  for (ssize_t i = 0; i < n && text[i] >= '0' && text[i] <= '9'; ++i) pid += text[i];
  return pid.empty() ? "unknown" : pid;
}

absl::Status CantWrite(const std::string& path, const char* otherwise) {
  if (errno == ENOSPC || errno == EDQUOT) {
    return absl::ResourceExhaustedError(absl::StrCat(path, ": the disk is full; make room"));
  }
  return absl::ErrnoToStatus(errno, absl::StrCat(path, otherwise));
}

// `path`: what `fd` has open; `dir`: the data folder, in which the holder's file is.
absl::Status Lock(int fd, const std::string& path, const std::string& dir) {
  if (flock(fd, LOCK_EX | LOCK_NB) == 0) return absl::OkStatus();
  if (errno != EWOULDBLOCK)
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be locked"));
  return absl::FailedPreconditionError(
      absl::StrCat("another daemon (process ", ReadHolder(dir + "/lock"), ") works on ", dir,
                   "; stop it, or give this one a data folder of its own with --data"));
}

}  // namespace

absl::StatusOr<DataLock> DataLock::Take(const std::string& dir) {
  // Not `dir` itself, which whoever makes a key in it locks.
  const std::string kept = dir + "/artefacts";
  if (mkdir(kept.c_str(), 0700) != 0 && errno != EEXIST) return CantWrite(kept,
      ": can't be created");
  Fd folder(open(kept.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder.valid()) return absl::ErrnoToStatus(errno, absl::StrCat(kept, ": can't be opened"));
  RETURN_IF_ERROR(Lock(folder.get(), kept, dir));
  const std::string path = dir + "/lock";
  Fd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!fd.valid()) {
    return CantWrite(path, ": can't be opened for writing; check the data folder's rights");
  }
  RETURN_IF_ERROR(Lock(fd.get(), path, dir));
  const std::string pid = absl::StrCat(getpid(), "\n");
  if (ftruncate(fd.get(), 0) != 0 ||
      pwrite(fd.get(), pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size())) {
    return CantWrite(path, ": can't be written");
  }
  return DataLock(std::move(folder), std::move(fd));
}

// Device numbers and the host's name are left out, as a restart may change them.
absl::StatusOr<DataHome> ReadDataHome(const std::string& dir) {
  struct statx info = {};
  if (statx(AT_FDCWD, dir.c_str(), 0, STATX_INO | STATX_BTIME, &info) != 0) {
    return absl::UnavailableError(absl::StrCat(dir, ": can't be examined"));
  }
  const std::string machine = ReadFile("/etc/machine-id").value_or("");  // none in most containers
  const bool dated = (info.stx_mask & STATX_BTIME) != 0;
  const std::string born =
      dated ? absl::StrCat(info.stx_btime.tv_sec, ".", info.stx_btime.tv_nsec) : "";
  return DataHome{
      Sha256Hex(absl::StrCat("a data folder\n", machine, "\n", info.stx_ino, "\n", born)),
      absl::StrCat(dir, " on host ", HostName())};
}

}  // namespace myograde::server
