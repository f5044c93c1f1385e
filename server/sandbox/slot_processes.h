// Tells the living processes of a daemon's slots from all others, whoever started them: possibly
// another daemon, whose runners are dead.
//
// If root runs the daemon, each slot has its own users. An ordinary user's slots each have a mark:
// an empty host folder that every sandbox of the slot mounts. Its place in its file system can be
// read from outside in a process' mountinfo, and a process that can't change mounts, create a
// namespace or choose another root can't remove it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include <absl/status/status.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// The users of the sandboxes when root starts them: one for each of a lease's two sandboxes, all in
// the range of 8192 ids from server.json's uid_base on, which nobody else may use. User and group
// ids are equal.
//
//   uid_base +    0 ...  policies of the daemon's slots
//   uid_base + 1024 ...  policies of `myograde local`
//   uid_base + 2048      the doctor's trial policy
//   uid_base + 2304      the daemon's reference episodes, which have no policy
//   uid_base + 2560      the episodes that the daemon makes pictures of, likewise
//   uid_base + 3072 ...  replays of logs, which have none either
//   uid_base + 4096 ...  the simulators, in the same order
//
// With separate users, a policy that escaped from its namespaces still owns nothing of its
// simulator's, and the other way round.
inline constexpr int64_t kMostSlots = 1024;
inline constexpr int64_t kLocalUsers = 1024;
inline constexpr int64_t kDoctorUsers = 2048;
inline constexpr int64_t kReferenceUsers = 2304;
inline constexpr int64_t kPictureUsers = 2560;
inline constexpr int64_t kReplayUsers = 3072;
inline constexpr int64_t kSimUsers = 4096;

// The simulator's user for a policy's user; -1 (the caller's own) stays -1.
constexpr int64_t SimUser(int64_t policy_user) {
  return policy_user < 0 ? -1 : policy_user + kSimUsers;
}

class SlotProcesses {
 public:
  // `uid_base`: first of the slots' users; -1 if they have none. Then their marks lie in `folder`,
  // which is absolute, created on demand and used by this daemon's data folder alone.
  SlotProcesses(int64_t uid_base, std::string folder)
      : uid_base_(uid_base), folder_(std::move(folder)) {}

  // Marks an order's processes as its slot's. An error: the mark can't be created.
  absl::Status Claim(LeaseOrder& order) const;

  // Living processes of `count` slots from `first` on: by slot, described for people. Processes
  // that this one may not inspect are not found. Costs a few microseconds per process of the host,
  // and reads one mount table per mount namespace of the own user.
  std::map<int, std::string> Find(int first, int count) const;

 private:
  const int64_t uid_base_;
  const std::string folder_;
};

}  // namespace myograde::server
