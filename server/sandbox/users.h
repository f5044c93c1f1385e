// The users of the sandboxes where root starts them: one for each of the two
// sandboxes of a lease, all in the range of kUsers ids that begins at server.json's
// uid_base and that nobody else may have. User and group ids are alike.
//
//   uid_base +    0 ...  policies of the daemon's slots
//   uid_base + 1024 ...  policies of `myograde local`
//   uid_base + 2048      the doctor's trial policy
//   uid_base + 2304      the daemon's reference episodes, which have no policy
//   uid_base + 3072 ...  replays of logs, which have none either
//   uid_base + 4096 ...  the simulators, in the same order
//
// With users of their own a policy that left its namespaces still owns nothing
// of its simulator's, and the other way round.
#pragma once

#include <cstdint>

namespace myograde::server {

inline constexpr int64_t kMostSlots = 1024;
inline constexpr int64_t kLocalUsers = 1024;
inline constexpr int64_t kDoctorUsers = 2048;
inline constexpr int64_t kReferenceUsers = 2304;
inline constexpr int64_t kReplayUsers = 3072;
inline constexpr int64_t kSimUsers = 4096;
inline constexpr int64_t kUsers = 8192;

// The simulator's user beside the policy's; -1 (the caller's own) stays -1.
constexpr int64_t SimUser(int64_t policy_user) {
  return policy_user < 0 ? -1 : policy_user + kSimUsers;
}

}  // namespace myograde::server
