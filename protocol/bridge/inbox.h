// Classifies every message from the bus: the expected answer, a harmless late copy, a stray, or a
// breach of the protocol. Pure: no sockets, no clock, no memory beyond its own size.
#pragma once

#include <cstdint>
#include <span>

#include <absl/status/status.h>

#include "myograde/action_t.hpp"
#include "protocol/bridge/datagram.h"
#include "protocol/bridge/frames.h"

namespace myograde::bridge {

// Limits per episode; start-up counts towards the first.
struct InboxLimits {
  int64_t stray_messages;  // messages that answer nothing
  int64_t wrong_answers;   // answers to a step or episode that is not the one asked
};

enum class Disposition {
  kDropped,        // nothing to do
  kFrame,          // frame() goes to the simulator, which ends the wait
  kResendWelcome,  // the policy missed the welcome: send it again
  kFault,          // frame() is a FaultFrame; all later messages are ignored
};

class Inbox {
 public:
  explicit Inbox(InboxLimits limits) : limits_(limits) {}

  // The simulator publishes `frame` (its payload is ignored): waits for its answer from now on. A
  // new episode resets the counts.
  void Ask(const PublishFrame& frame);

  // The outstanding message was resent, so one more answer may arrive.
  void AskedAgain() { ++free_duplicates_; }

  // True while an answer is outstanding.
  bool waiting() const { return expect_ != Expect::kNothing; }

  // Classifies a datagram from another sender.
  Disposition Take(std::span<const std::byte> datagram);

  // The frame of the last Take(); valid until the next one.
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
  Expect expect_ = Expect::kHello;  // a policy starts with hello
  bool greeted_ = false;
  int64_t episode_ = -1;  // the last one asked
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

// A FaultFrame with `sentence` made printable and truncated to fit.
FaultFrame MakeFault(BridgeFault fault, int64_t value, std::string_view sentence);

}  // namespace myograde::bridge
