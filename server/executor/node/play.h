// Plays one attempt of a lease on a node: takes the order out of a channel, proves the node, plays
// with the same runner as everywhere, and sends back what it prints.
#pragma once

#include <string>

#include <absl/time/time.h>

#include "server/executor/node/channel.h"
#include "server/executor/node/relay.h"

namespace myograde::server {

struct PlayOptions {
  std::string cache_dir;
  std::string config_dir;
  std::string node_dir;  // of this node alone, private to its user; must be there
  std::string lease;     // name of the attempt
  int stop = -1;         // a signalfd: the host wants the lease to end
  RelayLimits relay = {};
  absl::Duration order_deadline = absl::Minutes(1);  // for the order to be there
  // For the last words, once the lease was to end at once: the host kills soon after it asked.
  absl::Duration farewell = absl::Seconds(20);
};

// Returns an exit status (forms.h). Never waits for a disk or a network that hangs for longer than its
// deadlines: then it ends the process itself, with kNodeTrouble.
int PlayLease(LeaseChannel& channel, const PlayOptions& options);

}  // namespace myograde::server
