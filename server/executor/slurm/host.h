// A lease's end on the daemon's host: a process of its own that has Slurm start the other end on a
// node, and prints for the daemon what a runner on this host would print, and NodeRecords. Whatever
// may wait for a network, a disk or Slurm waits here.
#pragma once

#include <string>

namespace myograde::server {

// `order`: the file of a ClusterOrder. Standard input is the daemon's hand on it: the lease ends when it
// does, or when `stop`, a signalfd, is readable; then the job is cancelled. Returns the exit status of
// the lease's runner; 4 also for other trouble that is the grader's, which standard error tells.
int FollowLease(const std::string& order, int stop);

}  // namespace myograde::server
