#include "server/runner/log_keeper.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/sim_channel.h"

namespace myograde::server {
namespace {

constexpr size_t kBufferBytes = 64 << 10;

absl::Status TrajectoryTrouble(const std::string& path, const char* what) {
  return absl::InternalError(
      absl::StrCat("the trajectory ", path, " can't be ", what, ": ", std::strerror(errno)));
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

absl::Status LogKeeper::Keep(const std::string& folder, const std::string& lease,
                             const EpisodeLogInfo& info, std::string_view bytes) {
  ASSIGN_OR_RETURN(LogKeeper keeper, Open(folder, lease, std::ssize(bytes)));
  RETURN_IF_ERROR(keeper.Write(bytes));
  return keeper.Finish(info);
}

LogKeeper::~LogKeeper() {
  if (file_.valid()) unlinkat(directory_.get(), draft_.c_str(), 0);
}

absl::Status LogKeeper::Trouble(const char* what) const {
  return absl::ResourceExhaustedError(absl::StrCat("an episode's log can't be ", what, " in ",
                                                   folder_, ": ", std::strerror(errno)));
}

absl::Status LogKeeper::Drain() { return Take(kBufferBytes).status(); }

absl::StatusOr<size_t> LogKeeper::Take(size_t most) {
  std::vector<char> buffer(std::min(most, kBufferBytes));
  while (true) {
    const ssize_t n = read(reader_.get(), buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return 0;
    RETURN_IF_ERROR(Write({buffer.data(), static_cast<size_t>(n)}));
    return static_cast<size_t>(n);
  }
}

absl::Status LogKeeper::Write(std::string_view bytes) {
  if (!file_.valid()) {
    unlinkat(directory_.get(), draft_.c_str(), 0);
    file_ = Fd(openat(directory_.get(), draft_.c_str(),
                      O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
    if (!file_.valid()) return Trouble("made");
    written_ = 0;
  }
  written_ += std::ssize(bytes);
  // A single Drain() may read the end of one log and the start of the next.
  if (written_ > budget_ + static_cast<int64_t>(kBufferBytes)) return TooLarge();
  return WriteAll(file_.get(), bytes).ok() ? absl::OkStatus() : Trouble("written");
}

absl::Status LogKeeper::TooLarge() const {
  return absl::InternalError(
      absl::StrCat("the simulator sent a log of more than ", budget_, " bytes (log_bytes)"));
}

absl::Status LogKeeper::Finish(const EpisodeLogInfo& info) {
  if (info.packed_bytes > budget_) return TooLarge();
  while (written_ < info.packed_bytes) {
    ASSIGN_OR_RETURN(size_t taken, Take(static_cast<size_t>(info.packed_bytes - written_)));
    if (taken == 0) break;
  }
  if (!file_.valid() || written_ < info.packed_bytes || info.packed_bytes <= 0 ||
      !IsSha256Hex(info.sha256)) {
    return absl::InternalError(
        absl::StrCat("the simulator reported a log of ", info.packed_bytes, " bytes and sent ",
                     written_));
  }
  // The simulator goes on meanwhile, so the same bytes may contain the start of the next log.
  std::vector<char> next(static_cast<size_t>(written_ - info.packed_bytes));
  if (!next.empty()) {
    if (pread(file_.get(), next.data(), next.size(), info.packed_bytes) !=
            static_cast<ssize_t>(next.size()) ||
        ftruncate(file_.get(), info.packed_bytes) != 0) {
      return Trouble("cut");
    }
  }
  if (fdatasync(file_.get()) != 0) return Trouble("written");
  file_.reset();
  written_ = 0;
  if (renameat(directory_.get(), draft_.c_str(), directory_.get(),
               LogFileName(info.sha256).c_str()) != 0) {
    return Trouble("kept");
  }
  return next.empty() ? absl::OkStatus() : Write({next.data(), next.size()});
}

absl::StatusOr<TrajectoryFile> TrajectoryFile::Make(const std::string& path) {
  Fd file(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!file.valid()) return TrajectoryTrouble(path, "made");
  Fd memory(memfd_create("myograde-trajectory", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (!memory.valid() || ftruncate(memory.get(), kMostTrajectoryFileBytes) != 0 ||
      fcntl(memory.get(), F_ADD_SEALS, F_SEAL_GROW | F_SEAL_SHRINK | F_SEAL_SEAL) != 0) {
    return TrajectoryTrouble(path, "given memory");
  }
  return TrajectoryFile(path, std::move(file), std::move(memory));
}

absl::Status TrajectoryFile::Keep(int64_t bytes) {
  if (bytes <= 0 || bytes > kMostTrajectoryFileBytes) {
    return absl::InternalError(
        absl::StrCat("the simulator reported a trajectory of ", bytes, " bytes"));
  }
  for (off_t at = 0; at < bytes;) {
    const ssize_t n = sendfile(file_.get(), memory_.get(), &at, static_cast<size_t>(bytes - at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return TrajectoryTrouble(path_, "written");
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
