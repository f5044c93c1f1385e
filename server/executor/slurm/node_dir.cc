#include "server/executor/slurm/node_dir.h"

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
#include <absl/time/clock.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/artefact/share_files.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kLockPoll = absl::Milliseconds(100);
// For another lease to unpack a submission.
constexpr absl::Duration kUnpacking = absl::Minutes(10);
constexpr char kHeldTooLong[] =
    "another lease has been unpacking this submission for too long on this node";

absl::Status MakePrivate(const std::string& path) {
  std::error_code error;
  if (fs::create_directory(path, error); error) {
    return absl::UnavailableError(absl::StrCat(path, ": can't be made: ", error.message()));
  }
  fs::permissions(path, fs::perms::owner_all, error);
  return absl::OkStatus();
}

bool IsFolder(const std::string& path) {
  struct stat info;
  return lstat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

// REQUIRES: the lock of `place` is this process' alone.
absl::Status Unpack(const std::string& place, const std::string& digest, const ByteSource& source) {
  const std::string part = place + ".part";
  std::error_code ignored;
  fs::remove_all(part, ignored);
  RETURN_IF_ERROR(PlaceStreamedArtefact(source, digest, part));
  // A node that loses its power must not find half a submission under the whole one's name.
  const Fd placed(open(part.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!placed.valid() || syncfs(placed.get()) != 0) {
    return HostError(absl::StrCat("can't write ", part, " to the disk"));
  }
  if (rename(part.c_str(), place.c_str()) != 0) {
    return HostError(absl::StrCat("can't put ", part, " in place"));
  }
  return absl::OkStatus();
}

void MakeRoom(const std::string& artefacts, int64_t most_bytes) {
  std::vector<std::tuple<int64_t, std::string, int64_t>> known;  // last use, place, bytes
  int64_t total = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(artefacts, error)) {
    const std::string place = entry.path();
    struct stat info;
    if (!IsSha256Hex(entry.path().filename().string()) ||
        stat((place + ".lock").c_str(), &info) != 0) {
      continue;
    }
    const int64_t bytes = DiskBytes(place);
    known.emplace_back(info.st_mtim.tv_sec, place, bytes);
    total += bytes;
  }
  std::sort(known.begin(), known.end());
  for (const auto& [used, place, bytes] : known) {
    if (total <= most_bytes) return;
    const absl::StatusOr<Fd> lock = OpenLock(place + ".lock");
    // One that is played stays.
    if (!lock.ok() || flock(lock->get(), LOCK_EX | LOCK_NB) != 0) continue;
    fs::remove_all(place, error);
    total -= bytes;
  }
}

}  // namespace

absl::StatusOr<Fd> OpenLock(const std::string& path) {
  Fd lock(open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!lock.valid()) return HostError(absl::StrCat("can't open ", path));
  return lock;
}

absl::Status TakeLock(const Fd& lock, int how, const Deadline& deadline, const std::string& why) {
  while (flock(lock.get(), how | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK && errno != EINTR) return HostError("can't take a lock");
    if (deadline.over()) return absl::DeadlineExceededError(why);
    absl::SleepFor(kLockPoll);
  }
  return absl::OkStatus();
}

absl::StatusOr<NodeSlot> NodeSlot::Take(const std::string& node_dir, int64_t uid_base) {
  if (geteuid() == 0 && uid_base < 0) {
    return absl::InvalidArgumentError(
        "this node runs leases as root and was given no users for their sandboxes; run the daemon as "
        "root too, or let the cluster run its jobs as an ordinary user");
  }
  for (const char* name : {"/slots", "/work"}) {
    RETURN_IF_ERROR(MakePrivate(node_dir + name));
  }
  const SlotProcesses processes(geteuid() == 0 ? uid_base : -1, node_dir + "/marks");
  for (int number = 0; number < kMostSlots; ++number) {
    ASSIGN_OR_RETURN(Fd lock, OpenLock(absl::StrCat(node_dir, "/slots/", number)));
    if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) continue;
    // What a killed lease left in it must be dead first.
    if (!processes.Find(number, 1).empty()) continue;
    return NodeSlot(number, std::move(lock), absl::StrCat(node_dir, "/work/", number), processes);
  }
  return absl::ResourceExhaustedError(
      absl::StrCat("all ", kMostSlots, " slots of this node are taken"));
}

absl::Status NodeSlot::Prepare(LeaseOrder& order) const {
  CleanUp();
  for (const std::string& path : {work_dir_, work_dir_ + "/lease", work_dir_ + "/logs"}) {
    RETURN_IF_ERROR(MakePrivate(path));
  }
  order.slot = number_;
  order.uid = -1;
  order.work_dir = work_dir_ + "/lease";
  return processes_.Claim(order);
}

void NodeSlot::CleanUp() const {
  std::error_code ignored;
  fs::remove_all(work_dir_, ignored);
}

absl::StatusOr<HeldArtefact> HoldArtefact(const std::string& node_dir, const std::string& digest,
                                          const ByteSource& source, int64_t most_bytes) {
  const std::string artefacts = node_dir + "/artefacts";
  if (::mkdir(artefacts.c_str(), 0700) != 0 && errno != EEXIST) {
    return HostError(absl::StrCat("can't make ", artefacts));
  }
  const std::string place = absl::StrCat(artefacts, "/", digest);
  ASSIGN_OR_RETURN(Fd lock, OpenLock(place + ".lock"));
  const Deadline deadline(kUnpacking);
  for (;;) {
    RETURN_IF_ERROR(TakeLock(lock, LOCK_SH, deadline, kHeldTooLong));
    if (IsFolder(place)) {
      // When it was used last; the lock's own time, as the folder's is part of what is played.
      futimens(lock.get(), nullptr);
      return HeldArtefact{place, std::move(lock)};
    }
    RETURN_IF_ERROR(TakeLock(lock, LOCK_EX, deadline, kHeldTooLong));
    if (IsFolder(place)) continue;
    MakeRoom(artefacts, most_bytes);
    RETURN_IF_ERROR(Unpack(place, digest, source));
  }
}

}  // namespace myograde::server
