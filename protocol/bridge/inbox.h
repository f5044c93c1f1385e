// Judges every message that comes from the bus: is it the answer that is waited
// for, a harmless late copy, a stray, or a breach of the protocol? Pure: no
// sockets, no clock, no memory beyond its own size.
#pragma once

#include <cstdint>
#include <span>

#include <absl/status/status.h>

#include "myograde/action_t.hpp"
#include "protocol/bridge/datagram.h"
#include "protocol/bridge/frames.h"

namespace myograde::bridge {

// Limits per episode; the start-up counts to the first.
struct InboxLimits {
  int64_t stray_messages;  // messages that answer nothing
  int64_t wrong_answers;   // answers to a step or an episode that was not asked
};

enum class Disposition {
  kDropped,     // nothing to do
  kFrame,       // frame() goes to the simulator; the waiting is over
  kSayAgain,    // the policy missed the welcome: send it again
  kFault,       // frame() is a FaultFrame; nothing more will be looked at
};

class Inbox {
 public:
  explicit Inbox(InboxLimits limits) : limits_(limits) {}

  // The simulator publishes `frame` (its payload is not looked at): from now
  // on its answer is waited for. A new episode starts the counts afresh.
  void Ask(const PublishFrame& frame);

  // The outstanding message was sent once more, so one more answer may come.
  void AskedAgain() { ++free_duplicates_; }

  // True while an answer is waited for.
  bool waiting() const { return expect_ != Expect::kNothing; }

  // Judges one datagram of another sender.
  Disposition Take(std::span<const std::byte> datagram);

  // The frame of the last verdict; valid until the next call of Take.
  std::span<const std::byte> frame() const { return frame_; }

 private:
  Disposition TakeHello(std::span<const std::byte> payload);
  Disposition TakeReady(std::span<const std::byte> payload);
  Disposition TakeAction(std::span<const std::byte> payload);
  Disposition TakeGiveUp(std::span<const std::byte> payload);
  template <typename F>
  Disposition TakeStep(F& frame, FrameType type);
  Disposition Stray();
  Disposition LateCopy();
  Disposition WrongAnswer(const std::string& sentence);
  Disposition Breach(std::string_view channel, const absl::Status& status);
  Disposition Fault(BridgeFault fault, int64_t value, std::string_view sentence);
  template <typename F>
  Disposition Answer(F& frame, FrameType type);

  const InboxLimits limits_;
  Expect expect_ = Expect::kHello;  // the first thing that a policy says
  bool greeted_ = false;
  int64_t episode_ = -1;  // asked last
  int64_t step_ = -1;
  uint32_t action_size_ = 0;
  int64_t stray_ = 0;
  int64_t wrong_ = 0;
  int64_t free_duplicates_ = 0;
  bool faulted_ = false;

  action_t scratch_;
  HelloFrame hello_ = {};
  ReadyFrame ready_ = {};
  ActionFrame action_ = {};
  GiveUpFrame give_up_ = {};
  FaultFrame fault_ = {};
  std::span<const std::byte> frame_;
};

// A FaultFrame with `sentence` made printable and cut to fit.
FaultFrame MakeFault(BridgeFault fault, int64_t value, std::string_view sentence);

}  // namespace myograde::bridge
