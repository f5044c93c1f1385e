#include "server/cli/base/new_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

bool IsNoFile(const std::string& path) {
  struct stat info;
  return stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
}

}  // namespace

absl::Status CantWrite(const std::string& path) {
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": can't be written: ", std::strerror(errno), "; choose another place or make room"));
}

NewFile::NewFile(std::string path, mode_t mode)
    : path_(std::move(path)), in_place_(IsNoFile(path_)), part_(path_ + ".part") {
  if (in_place_) {
    fd_ = Fd(open(path_.c_str(), O_WRONLY | O_CLOEXEC));
    return;
  }
  // One that an earlier run left, or that another user has put there to read along.
  unlink(part_.c_str());
  fd_ = Fd(open(part_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode));
}

NewFile::~NewFile() {
  if (fd_.valid() && !in_place_) unlink(part_.c_str());
}

bool NewFile::Write(std::string_view text) {
  hash_.Update(text);
  while (!text.empty()) {
    const ssize_t n = write(fd_.get(), text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      error_ = errno;
      return false;
    }
    text.remove_prefix(static_cast<size_t>(n));
  }
  return true;
}

absl::StatusOr<std::string> NewFile::Keep() {
  if (!in_place_ && (fsync(fd_.get()) != 0 || rename(part_.c_str(), path_.c_str()) != 0)) {
    return CantWrite(path_);
  }
  fd_.reset();
  return hash_.FinishHex();
}

absl::StatusOr<std::string> WriteNewFile(const std::string& path, std::string_view content,
                                         mode_t mode) {
  NewFile file(path, mode);
  if (!file.opened() || !file.Write(content)) return CantWrite(path);
  return file.Keep();
}

}  // namespace myograde::server
