// What the daemon's host and a node send each other while a lease is played, over the standard
// streams of srun: messages of a kind and some bytes, as "KIND SIZE\n", the bytes and
// a line feed.
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
#include <optional>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

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

}  // namespace myograde::server
