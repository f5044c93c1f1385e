// Whether the daemon can do its work now: take submissions and play them.
#pragma once

#include <string>
#include <vector>

#include "server/api/context.h"

namespace myograde::server {

// Something that may stand in the way, for programs and for people.
struct Obstacle {
  std::string code;
  std::string message;  // "": it does not
};

// All that there can be, in this order:
//   stopping   the daemon is about to end
//   store      the store can't be written
//   disk       the data folder's disk has less room than uploads must leave
//   host       no lease starts: the host is being tested, or paused
//   slots      every slot is closed by processes that can't be killed yet
//   cluster    nothing can start on the cluster, or one lease after the other is lost
//   simulator  a program that plays leases is missing
// Only inside handlers.
std::vector<Obstacle> FindObstacles(const ApiContext& context, const LiveHealth& health);

// "store" (it can't be written), "paused" (no lease starts), "degraded" (leases are lost) or "ok".
const char* StatusText(const LiveHealth& health);

}  // namespace myograde::server
