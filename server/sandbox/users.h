// The users of the sandboxes when root starts them: one for each of a lease's two sandboxes, all in
// the range of kUsers ids from server.json's uid_base on, which nobody else may use. User and group
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
#pragma once

#include <cstdint>

namespace myograde::server {

inline constexpr int64_t kMostSlots = 1024;
inline constexpr int64_t kLocalUsers = 1024;
inline constexpr int64_t kDoctorUsers = 2048;
inline constexpr int64_t kReferenceUsers = 2304;
inline constexpr int64_t kPictureUsers = 2560;
inline constexpr int64_t kReplayUsers = 3072;
inline constexpr int64_t kSimUsers = 4096;
inline constexpr int64_t kUsers = 8192;

// The simulator's user for a policy's user; -1 (the caller's own) stays -1.
constexpr int64_t SimUser(int64_t policy_user) {
  return policy_user < 0 ? -1 : policy_user + kSimUsers;
}

}  // namespace myograde::server
