#include "server/runner/log_keeper.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr size_t kBufferBytes = 64 << 10;

bool IsHash(const std::string& text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

std::string LogFileName(const std::string& sha256) { return sha256 + ".lcmlog.zst"; }

absl::StatusOr<LogKeeper> LogKeeper::Open(const std::string& folder, const std::string& lease,
                                          int64_t budget) {
  LogKeeper keeper;
  keeper.folder_ = folder;
  keeper.draft_ = absl::StrCat(".draft-", lease);
  keeper.budget_ = budget;
  keeper.directory_ = Fd(open(folder.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!keeper.directory_.valid()) {
    return absl::InternalError(absl::StrCat("the folder for episodes' logs, ", folder,
                                            ", can't be opened: ", std::strerror(errno)));
  }
  int ends[2];
  if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0) {
    return absl::InternalError(absl::StrCat("can't make a pipe: ", std::strerror(errno)));
  }
  keeper.reader_ = Fd(ends[0]);
  keeper.writer_ = Fd(ends[1]);
  return keeper;
}

LogKeeper::~LogKeeper() {
  if (file_.valid()) unlinkat(directory_.get(), draft_.c_str(), 0);
}

absl::Status LogKeeper::Trouble(const char* what) const {
  return absl::ResourceExhaustedError(absl::StrCat("an episode's log can't be ", what, " in ",
                                                   folder_, ": ", std::strerror(errno)));
}

absl::Status LogKeeper::Drain() {
  std::vector<char> buffer(kBufferBytes);
  while (true) {
    const ssize_t n = read(reader_.get(), buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return absl::OkStatus();
    if (absl::Status status = Write(buffer.data(), static_cast<size_t>(n)); !status.ok()) {
      return status;
    }
  }
}

absl::Status LogKeeper::Write(const char* bytes, size_t size) {
  if (!file_.valid()) {
    unlinkat(directory_.get(), draft_.c_str(), 0);
    file_ = Fd(openat(directory_.get(), draft_.c_str(),
                      O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
    if (!file_.valid()) return Trouble("made");
    written_ = 0;
  }
  written_ += static_cast<int64_t>(size);
  if (written_ > budget_) {
    return absl::InternalError(
        absl::StrCat("the simulator sent a log of more than ", budget_, " bytes (log_bytes)"));
  }
  while (size > 0) {
    const ssize_t n = write(file_.get(), bytes, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return Trouble("written");
    bytes += n;
    size -= static_cast<size_t>(n);
  }
  return absl::OkStatus();
}

absl::Status LogKeeper::Finish(const EpisodeLogInfo& info) {
  if (absl::Status status = Drain(); !status.ok()) return status;
  if (!file_.valid() || written_ != info.packed_bytes || !IsHash(info.sha256)) {
    return absl::InternalError(
        absl::StrCat("the simulator told of a log of ", info.packed_bytes, " bytes and sent ",
                     file_.valid() ? written_ : 0));
  }
  if (fdatasync(file_.get()) != 0) return Trouble("written");
  file_.reset();
  if (renameat(directory_.get(), draft_.c_str(), directory_.get(),
               LogFileName(info.sha256).c_str()) != 0) {
    return Trouble("kept");
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
