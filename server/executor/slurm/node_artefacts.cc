#include "server/executor/slurm/node_artefacts.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <tuple>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/executor/slurm/node_slot.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kLockEnding[] = ".lock";
constexpr char kHeldTooLong[] =
    "another lease has been unpacking this submission for too long on this node";

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

std::string NodeArtefacts::LockPath(const std::string& digest) const {
  return absl::StrCat(folder_, "/", digest, kLockEnding);
}

absl::StatusOr<HeldArtefact> NodeArtefacts::Hold(const std::string& digest,
                                                 const ByteSource& source,
                                                 absl::Duration patience) const {
  if (::mkdir(folder_.c_str(), 0700) != 0 && errno != EEXIST) {
    return HostError(absl::StrCat("can't make ", folder_));
  }
  const std::string folder = folder_ + "/" + digest;
  ASSIGN_OR_RETURN(Fd lock, OpenLock(LockPath(digest)));
  const Deadline deadline(patience);
  for (;;) {
    RETURN_IF_ERROR(TakeLock(lock, LOCK_SH, deadline, kHeldTooLong));
    if (IsFolder(folder)) {
      // When it was used last; the lock's own time, as the folder's is part of what is played.
      futimens(lock.get(), nullptr);
      return HeldArtefact(folder, std::move(lock));
    }
    RETURN_IF_ERROR(TakeLock(lock, LOCK_EX, deadline, kHeldTooLong));
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
  if (!placed.valid() || syncfs(placed.get()) != 0) {
    return HostError(absl::StrCat("can't write ", part, " to the disk"));
  }
  if (rename(part.c_str(), (folder_ + "/" + digest).c_str()) != 0) {
    return HostError(absl::StrCat("can't put ", part, " in place"));
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
    if (!IsSha256Hex(digest) || stat(LockPath(digest).c_str(), &info) != 0) continue;
    const int64_t bytes = BytesBelow(entry.path());
    known.emplace_back(info.st_mtim.tv_sec, digest, bytes);
    total += bytes;
  }
  std::sort(known.begin(), known.end());
  for (const auto& [used, digest, bytes] : known) {
    if (total <= most_bytes_) return;
    const absl::StatusOr<Fd> lock = OpenLock(LockPath(digest));
    // One that is played stays.
    if (!lock.ok() || flock(lock->get(), LOCK_EX | LOCK_NB) != 0) continue;
    fs::remove_all(folder_ + "/" + digest, error);
    total -= bytes;
  }
}

}  // namespace myograde::server
