#include "server/executor/slurm/node_slot.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/sandbox/slot_processes.h"
#include "server/sandbox/users.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kLockPoll = absl::Milliseconds(100);

SlotProcesses ProcessesOf(const std::string& node_dir, int64_t uid_base) {
  return SlotProcesses(geteuid() == 0 ? uid_base : -1, node_dir + "/marks");
}

absl::Status MakePrivate(const std::string& path) {
  std::error_code error;
  if (fs::create_directory(path, error); error) {
    return absl::UnavailableError(absl::StrCat(path, ": can't be made: ", error.message()));
  }
  fs::permissions(path, fs::perms::owner_all, error);
  return absl::OkStatus();
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

NodeSlot::NodeSlot(int number, Fd lock, std::string node_dir, int64_t uid_base)
    : number_(number),
      lock_(std::move(lock)),
      node_dir_(std::move(node_dir)),
      work_dir_(absl::StrCat(node_dir_, "/work/", number)),
      uid_base_(uid_base) {}

absl::StatusOr<NodeSlot> NodeSlot::Take(const std::string& node_dir, int64_t uid_base) {
  if (geteuid() == 0 && uid_base < 0) {
    return absl::InvalidArgumentError(
        "this node runs leases as root and was given no users for their sandboxes; run the daemon as "
        "root too, or let the cluster run its jobs as an ordinary user");
  }
  for (const char* name : {"/slots", "/work"}) {
    RETURN_IF_ERROR(MakePrivate(node_dir + name));
  }
  const SlotProcesses processes = ProcessesOf(node_dir, uid_base);
  for (int number = 0; number < kMostSlots; ++number) {
    ASSIGN_OR_RETURN(Fd lock, OpenLock(absl::StrCat(node_dir, "/slots/", number)));
    if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) continue;
    // What a killed lease left in it must be dead first.
    if (!processes.Find(number, 1).empty()) continue;
    return NodeSlot(number, std::move(lock), node_dir, uid_base);
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
  order.uid = geteuid() == 0 ? uid_base_ + number_ : -1;
  order.work_dir = work_dir_ + "/lease";
  return ProcessesOf(node_dir_, uid_base_).Claim(order);
}

void NodeSlot::CleanUp() const {
  std::error_code ignored;
  fs::remove_all(work_dir_, ignored);
}

}  // namespace myograde::server
