// Newcomers who found all places of theirs busy: they wait here until one of them
// is free, each peer's own in the order in which they came. Nothing is read of them
// meanwhile, so each costs a descriptor and little else.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/api/door.h"

namespace myograde::server {

// For one thread. Times are monotonic.
class WaitingLine {
 public:
  // At most `most` wait, at most `of_a_peer` of one peer.
  WaitingLine(int most, int of_a_peer)
      : most_(static_cast<size_t>(most)), of_a_peer_(static_cast<size_t>(of_a_peer)) {}

  bool empty() const { return waiting_ == 0; }
  // Whether somebody of that peer waits already, so that others of it come after.
  bool Has(const Peer& peer) const { return lines_.contains(peer.key); }

  // Who is not let in before `until` is told so, and who finds the line full is told at once. If
  // it is the whole line that is full, the last one of the peer with the most in it has to go.
  void Add(Newcomer newcomer, absl::Duration until);
  // Lets in whom `make_room` has a place for: organisers first, and peers in turns.
  void LetIn(const std::function<bool(const Peer&)>& make_room,
             const std::function<void(Newcomer)>& let_in);
  // Sends those away whose time is over at `now`, and forgets those who have hung up.
  void LookAtClocks(absl::Duration now);
  // Sends everybody away, and says why.
  void SendAway(const ApiError& error);

 private:
  struct Waiting {
    Newcomer who;
    absl::Duration until;
  };
  using Line = std::deque<Waiting>;

  std::vector<std::string> KeysInTurn() const;
  // Takes one out, whose line must have somebody in it.
  Waiting TakeFirst(const std::string& key);
  // The last one of the longest line is told to go, if that line is longer than `than`.
  bool SendLastAway(size_t than);

  const size_t most_;
  const size_t of_a_peer_;
  std::map<std::string, Line> lines_;  // by the peer's key; none is empty
  size_t waiting_ = 0;                 // in all of them
  std::string last_;                   // whose turn it was
};

}  // namespace myograde::server
