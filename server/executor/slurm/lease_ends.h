// The two ends of a lease on a cluster, each a process of its own.
#pragma once

#include <string>

namespace myograde::server {

// The end on the daemon's host: has Slurm start the other one on a node, and prints for the daemon
// what a runner on this host would print, and NodeRecords. Whatever may wait for a network, a disk
// or Slurm waits here. `order`: the file of a ClusterOrder. Standard input is the daemon's hand on
// it: the lease ends when it does, or when `stop`, a signalfd, is readable; then the job is
// cancelled. Returns the exit status of the lease's runner; 4 also for other trouble that is the
// grader's, which standard error tells.
int FollowLease(const std::string& order, int stop);

struct NodeOptions {
  std::string cache_dir;
  std::string config_dir;
  std::string node_dir;  // of this node alone, private to its user; must be there
  int stop = -1;         // a signalfd: Slurm wants the lease to end
};

// The end on a node of the cluster: takes the order from the daemon's host, proves the node, plays
// with the same runner as everywhere, and sends back what it prints. Talks over standard input and
// output (lease_stream.h), and returns an exit status: 0 once all was said, whatever it says; 4 if
// it could not be.
int PlayOnNode(const NodeOptions& options);

}  // namespace myograde::server
