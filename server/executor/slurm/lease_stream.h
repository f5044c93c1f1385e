// The two ends of a lease on a cluster, each a process of its own: on the daemon's host and on a
// node. What they send each other while it is played, over the standard streams of srun: messages
// of a kind and some bytes, as "KIND SIZE\n", the bytes and a line feed.
//
//   node   "node": a NodeRecord's line; the first message of all
//   host   "order": the ClusterOrder, as soon as the host hears of the node
//   node   "want": it does not have the submission
//   host   "data": pieces of its archive, an empty one last
//   node   "record": a line of the runner's
//   node   "log": the packed log that the next record names, after its name and a line feed
//   node   "end": how the runner ended, with its last record, as JSON; the last message
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

struct LeaseMessage {
  std::string kind;
  std::string bytes;
};

class LeaseStream {
 public:
  // Of an order, of a line, and of pieces of archives.
  static constexpr size_t kMostBytes = 4u << 20;

  // Neither descriptor is its own. `most`: largest message that is read.
  LeaseStream(int in, int out, size_t most = kMostBytes) : in_(in), out_(out), most_(most) {}

  // Takes in what has arrived; waits only if nothing has and the descriptor blocks. OutOfRangeError: at
  // the end. DataLossError: it ended within a message.
  absl::Status Fill();
  // The next message that is here as a whole; nullopt: none. DataLossError: these are no messages, or
  // one is too large.
  absl::StatusOr<std::optional<LeaseMessage>> Next();
  // Waits for the next message, which must be of this kind. DeadlineExceededError after `patience`.
  absl::StatusOr<std::string> Await(std::string_view kind, absl::Duration patience);

  // Waits until all of it is on its way.
  absl::Status Send(std::string_view kind, std::string_view bytes);

  // Takes in bytes from elsewhere.
  void Append(std::string_view bytes) { arrived_ += bytes; }

 private:
  const int in_;
  const int out_;
  const size_t most_;
  std::string arrived_;
};

// The order of a lease on a cluster: a file from the daemon to the process that looks after the
// lease on its host, which sends it on to the node as it is.
struct ClusterOrder {
  // With the daemon's folders, which a node replaces by its own, as it does user and slot.
  LeaseOrder order;
  std::string artefact;  // digest of the files in order.artefact_dir
  // Name and digest of LeaseOrder::runtimes, at the same place there; "": it is a folder that
  // nothing describes.
  std::vector<std::pair<std::string, std::string>> runtimes;
  std::string grader;     // the daemon's GraderBuild with the order's adapter, as canonical JSON
  int64_t uid_base = -1;  // first of the sandboxes' users where root runs the node; -1: none
  std::vector<std::string>
      prove_again;  // nodes that must, whatever they remember of an earlier proof

  // For the daemon's host.
  std::string comment;              // of this one alone
  std::vector<std::string> srun;    // words of the command line, with the node's program
  std::vector<std::string> squeue;  // words that show this store's jobs, those that are over too
  absl::Duration queue_wait;        // until a node must have begun it
};

std::string ClusterOrderToText(const ClusterOrder& order);
// InvalidArgumentError: which key is wrong, and how.
absl::StatusOr<ClusterOrder> ClusterOrderFromText(std::string_view text);

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
