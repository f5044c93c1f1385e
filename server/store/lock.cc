#include "server/store/lock.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

// The process id that the holder wrote; "unknown" if it has not done so yet.
std::string HolderOf(int fd) {
  char text[32] = {};
  const ssize_t n = pread(fd, text, sizeof(text) - 1, 0);
  std::string pid;
  for (ssize_t i = 0; i < n && text[i] >= '0' && text[i] <= '9'; ++i) pid += text[i];
  return pid.empty() ? "unknown" : pid;
}

}  // namespace

absl::StatusOr<DataLock> DataLock::Take(const std::string& dir) {
  const std::string path = dir + "/lock";
  // The file is never removed: otherwise two daemons could lock two files of the same name.
  Fd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!fd.valid()) {
    return absl::ErrnoToStatus(
        errno, absl::StrCat(path, ": can't be opened for writing; check the data folder's rights"));
  }
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) {
      return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be locked"));
    }
    return absl::FailedPreconditionError(
        absl::StrCat("another daemon (process ", HolderOf(fd.get()), ") works on ", dir,
                     "; stop it, or give this one a data folder of its own with --data"));
  }
  const std::string pid = absl::StrCat(getpid(), "\n");
  if (ftruncate(fd.get(), 0) != 0 ||
      pwrite(fd.get(), pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size())) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be written"));
  }
  return DataLock(std::move(fd));
}

}  // namespace myograde::server
