#include "server/executor/slurm/node_artefacts.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <tuple>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kLockPoll = absl::Milliseconds(100);
constexpr char kLockEnding[] = ".lock";
constexpr size_t kDigestDigits = 64;

absl::Status DiskError(const std::string& path, absl::string_view done) {
  const std::string message = absl::StrCat(path, ": can't be ", done, ": ", std::strerror(errno));
  return errno == ENOSPC || errno == EDQUOT ? absl::ResourceExhaustedError(message)
                                            : absl::UnavailableError(message);
}

// Takes the lock within `patience`.
absl::Status Lock(const Fd& lock, int how, const Deadline& deadline) {
  while (flock(lock.get(), how | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK && errno != EINTR) return DiskError("a submission's lock", "taken");
    if (deadline.over()) {
      return absl::DeadlineExceededError(
          "another lease has been unpacking this submission for too long on this node");
    }
    absl::SleepFor(kLockPoll);
  }
  return absl::OkStatus();
}

bool IsFolder(const std::string& path) {
  struct stat info;
  return lstat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

int64_t BytesBelow(const fs::path& folder) {
  int64_t bytes = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entries(folder, error), end; !error && entries != end;
       entries.increment(error)) {
    std::error_code ignored;
    if (entries->is_regular_file(ignored) && !entries->is_symlink(ignored)) {
      bytes += static_cast<int64_t>(entries->file_size(ignored));
    }
  }
  return bytes;
}

}  // namespace

absl::StatusOr<Fd> NodeArtefacts::OpenLock(const std::string& digest) const {
  const std::string path = absl::StrCat(folder_, "/", digest, kLockEnding);
  Fd lock(open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!lock.valid()) return DiskError(path, "opened");
  return lock;
}

absl::StatusOr<HeldArtefact> NodeArtefacts::Hold(const std::string& digest,
                                                 const ByteSource& source,
                                                 absl::Duration patience) const {
  if (::mkdir(folder_.c_str(), 0700) != 0 && errno != EEXIST) return DiskError(folder_, "made");
  const std::string folder = folder_ + "/" + digest;
  ASSIGN_OR_RETURN(Fd lock, OpenLock(digest));
  const Deadline deadline(patience);
  for (;;) {
    RETURN_IF_ERROR(Lock(lock, LOCK_SH, deadline));
    if (IsFolder(folder)) {
      // When it was used last; the lock's own time, as the folder's is part of what is played.
      futimens(lock.get(), nullptr);
      return HeldArtefact(folder, std::move(lock));
    }
    RETURN_IF_ERROR(Lock(lock, LOCK_EX, deadline));
    if (IsFolder(folder)) continue;
    MakeRoom();
    RETURN_IF_ERROR(Unpack(digest, source));
  }
}

// REQUIRES: its lock is this process' alone.
absl::Status NodeArtefacts::Unpack(const std::string& digest, const ByteSource& source) const {
  const std::string part = absl::StrCat(folder_, "/", digest, ".part");
  std::error_code ignored;
  fs::remove_all(part, ignored);
  RETURN_IF_ERROR(PlaceStreamedArtefact(source, digest, part));
  // A node that loses its power must not find half a submission under the whole one's name.
  const Fd placed(open(part.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!placed.valid() || syncfs(placed.get()) != 0) return DiskError(part, "written to the disk");
  if (rename(part.c_str(), (folder_ + "/" + digest).c_str()) != 0) {
    return DiskError(part, "put in place");
  }
  return absl::OkStatus();
}

void NodeArtefacts::MakeRoom() const {
  std::vector<std::tuple<int64_t, std::string, int64_t>> known;  // last use, digest, bytes
  int64_t total = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    const std::string digest = entry.path().filename();
    struct stat info;
    if (digest.size() != kDigestDigits ||
        stat(absl::StrCat(folder_, "/", digest, kLockEnding).c_str(), &info) != 0) {
      continue;
    }
    const int64_t bytes = BytesBelow(entry.path());
    known.emplace_back(info.st_mtim.tv_sec, digest, bytes);
    total += bytes;
  }
  std::sort(known.begin(), known.end());
  for (const auto& [used, digest, bytes] : known) {
    if (total <= most_bytes_) return;
    const absl::StatusOr<Fd> lock = OpenLock(digest);
    // One that is played stays.
    if (!lock.ok() || flock(lock->get(), LOCK_EX | LOCK_NB) != 0) continue;
    fs::remove_all(folder_ + "/" + digest, error);
    total -= bytes;
  }
}

}  // namespace myograde::server
