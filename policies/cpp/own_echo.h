// Keeps a bus of LCM from hearing what it says itself: multicast gives every
// message back to its sender, whose reader would wake for each answer only to
// throw it away.
#pragma once

#include <set>

namespace myograde {

class OwnEcho {
 public:
  // Before the bus is made: what is open now belongs to others.
  OwnEcho();

  // After the bus has subscribed and published: from here on the kernel drops
  // its own messages. False: it found no such sockets or the kernel refused;
  // the bus works as before.
  bool Silence() const;

 private:
  std::set<int> others_;
};

}  // namespace myograde
