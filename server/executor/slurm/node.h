// A lease's end on a node of the cluster: takes the order from the daemon's host, proves the node, plays
// with the same runner as everywhere, and sends back what it prints.
#pragma once

#include <string>

namespace myograde::server {

struct NodeOptions {
  std::string cache_dir;
  std::string config_dir;
  std::string node_dir;  // of this node alone, private to its user; must be there
  int stop = -1;         // a signalfd: Slurm wants the lease to end
};

// Talks over standard input and output (lease_stream.h), and returns an exit status: 0 once all was
// said, whatever it says; 4 if it could not be.
int PlayOnNode(const NodeOptions& options);

}  // namespace myograde::server
