#include "server/executor/slurm/log_taker.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string_view>
#include <vector>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/log/packed_log.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

constexpr size_t kCopyBytes = 64 << 10;

absl::Status LogTrouble(const std::string& logs, const char* what) {
  const std::string message = absl::StrCat("an episode's log can't be ", what, " in ", logs, ": ",
                                           std::strerror(errno));
  return errno == ENOSPC || errno == EDQUOT ? absl::ResourceExhaustedError(message)
                                            : absl::InternalError(message);
}

// Copies `source` to `target`, and checks what it unpacks to.
absl::Status CopyChecked(int source, int target, const EpisodeLogInfo& info,
                         const std::string& logs) {
  Sha256 hash;
  int64_t bytes = 0;
  LogUnpacker unpacker([&](std::string_view piece) {
    hash.Update(piece);
    bytes += std::ssize(piece);
    return absl::OkStatus();
  });
  std::vector<char> buffer(kCopyBytes);
  while (true) {
    const ssize_t n = ::read(source, buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      return absl::UnavailableError(absl::StrCat("an episode's log can't be read: ",
                                                 std::strerror(errno)));
    }
    if (n == 0) break;
    const std::string_view piece(buffer.data(), static_cast<size_t>(n));
    RETURN_IF_ERROR(unpacker.Take(piece));
    if (!WriteAll(target, piece).ok()) return LogTrouble(logs, "written");
  }
  RETURN_IF_ERROR(unpacker.End());
  if (bytes == info.bytes && hash.FinishHex() == info.sha256) return absl::OkStatus();
  return absl::DataLossError("its content has another digest");
}

}  // namespace

absl::Status TakeLog(const LeaseFolder& lease, const EpisodeLogInfo& info, const std::string& logs,
                     const std::string& draft) {
  const std::string name = LogFileName(info.sha256);
  if (!IsLogName(name)) return absl::DataLossError("a record names a log that can't be one");
  ASSIGN_OR_RETURN(const Fd source, lease.OpenLog(name));
  struct stat about;
  if (::fstat(source.get(), &about) != 0 || about.st_size != info.packed_bytes) {
    return absl::UnavailableError(absl::StrCat("the log ", name, " is not there as a whole"));
  }
  const Fd folder(::open(logs.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!folder.valid()) return LogTrouble(logs, "kept");
  const std::string unfinished = absl::StrCat(".draft-", draft);
  ::unlinkat(folder.get(), unfinished.c_str(), 0);
  const Fd target(::openat(folder.get(), unfinished.c_str(),
                           O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!target.valid()) return LogTrouble(logs, "made");
  absl::Cleanup remove = [&] { ::unlinkat(folder.get(), unfinished.c_str(), 0); };
  absl::Status copied = CopyChecked(source.get(), target.get(), info, logs);
  if (absl::IsDataLoss(copied)) {
    return absl::DataLossError(absl::StrCat("the log ", name, " is not the one that its record "
                                            "names: ", copied.message()));
  }
  if (!copied.ok()) return copied;
  if (::fdatasync(target.get()) != 0) return LogTrouble(logs, "written");
  if (::renameat(folder.get(), unfinished.c_str(), folder.get(), name.c_str()) != 0) {
    return LogTrouble(logs, "kept");
  }
  std::move(remove).Cancel();
  return absl::OkStatus();
}

}  // namespace myograde::server
