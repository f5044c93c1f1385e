#include "server/runner/trajectory_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/lease/sim_channel.h"

namespace myograde::server {
namespace {

constexpr int64_t kCopyBytes = 256 << 10;

absl::Status TrajectoryTrouble(const std::string& path, const char* what) {
  return absl::InternalError(
      absl::StrCat("the trajectory ", path, " can't be ", what, ": ", std::strerror(errno)));
}

}  // namespace

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
        absl::StrCat("the simulator told of a trajectory of ", bytes, " bytes"));
  }
  std::vector<char> buffer(static_cast<size_t>(std::min(bytes, kCopyBytes)));
  for (int64_t at = 0; at < bytes;) {
    const auto wanted = static_cast<size_t>(std::min<int64_t>(bytes - at, std::ssize(buffer)));
    const ssize_t n = pread(memory_.get(), buffer.data(), wanted, at);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return TrajectoryTrouble(path_, "read from the simulator");
    if (!WriteAll(file_.get(), std::string_view(buffer.data(), static_cast<size_t>(n))).ok()) {
      return TrajectoryTrouble(path_, "written");
    }
    at += n;
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
