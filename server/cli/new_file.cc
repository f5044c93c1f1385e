#include "server/cli/new_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include <absl/strings/str_cat.h>

namespace myograde::server {

absl::Status CantWrite(const std::string& path) {
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": can't be written: ", std::strerror(errno), "; choose another place or make room"));
}

NewFile::NewFile(std::string path) : path_(std::move(path)), part_(path_ + ".part") {
  // One that an earlier run left, or that another user has put there to read along.
  unlink(part_.c_str());
  fd_ = Fd(open(part_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
}

NewFile::~NewFile() {
  if (fd_.valid()) unlink(part_.c_str());
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
  if (fsync(fd_.get()) != 0 || rename(part_.c_str(), path_.c_str()) != 0) {
    return CantWrite(path_);
  }
  fd_.reset();
  return hash_.FinishHex();
}

}  // namespace myograde::server
