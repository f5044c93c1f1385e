#include "protocol/bridge/inbox.h"

#include <algorithm>
#include <array>
#include <string>
#include <tuple>

#include <absl/strings/str_cat.h>

#include "protocol/bridge/decode.h"
#include "protocol/policy/channels.h"

namespace myograde::bridge {
namespace {

constexpr std::array kGraderChannels = {kWelcomeChannel, kStartChannel, kObservationChannel,
                                        kEndChannel};

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

template <typename F>
std::span<const std::byte> BytesOf(const F& frame) {
  return std::as_bytes(std::span<const F, 1>(&frame, 1));
}

}  // namespace

FaultFrame MakeFault(BridgeFault fault, int64_t value, std::string_view sentence) {
  FaultFrame frame = {};
  frame.header = MakeHeader<FaultFrame>(FrameType::kFault);
  frame.fault = fault;
  frame.value = value;
  const size_t size = std::min(sentence.size(), sizeof(frame.detail) - 1);
  std::transform(sentence.begin(), sentence.begin() + static_cast<std::ptrdiff_t>(size),
                 frame.detail, [](char c) { return c >= ' ' && c <= '~' ? c : '?'; });
  return frame;
}

void Inbox::Ask(const PublishFrame& frame) {
  if (frame.channel == Channel::kEpisodeStart && frame.episode != episode_) {
    stray_ = 0;
    wrong_ = 0;
  }
  if (frame.channel == Channel::kEpisodeStart || frame.channel == Channel::kObservation) {
    episode_ = frame.episode;
    step_ = frame.step;
  }
  if (frame.action_size != 0) action_size_ = frame.action_size;
  expect_ = frame.expect;
}

Disposition Inbox::Take(std::span<const std::byte> datagram) {
  if (faulted_) return Disposition::kDropped;
  const std::optional<Datagram> parsed = ParseDatagram(datagram);
  if (!parsed) return Stray();
  if (parsed->channel == kActionChannel) return TakeAction(parsed->payload);
  if (parsed->channel == kGiveUpChannel) return TakeGiveUp(parsed->payload);
  if (parsed->channel == kReadyChannel) return TakeReady(parsed->payload);
  if (parsed->channel == kHelloChannel) return TakeHello(parsed->payload);
  if (std::find(kGraderChannels.begin(), kGraderChannels.end(), parsed->channel) !=
      kGraderChannels.end()) {
    return Breach(parsed->channel,
                  absl::PermissionDeniedError("only the grader may send on this channel"));
  }
  return Stray();
}

Disposition Inbox::TakeHello(std::span<const std::byte> payload) {
  // Later hellos are only checked for their form: the first one holds.
  HelloFrame later = {};
  HelloFrame& frame = greeted_ ? later : hello_;
  if (absl::Status status = DecodeHello(payload, frame); !status.ok()) {
    return Breach(kHelloChannel, status);
  }
  if (greeted_) {
    return Stray() == Disposition::kFault ? Disposition::kFault : Disposition::kResendWelcome;
  }
  greeted_ = true;
  return Answer(hello_, FrameType::kHello);
}

Disposition Inbox::TakeReady(std::span<const std::byte> payload) {
  if (absl::Status status = DecodeReady(payload, ready_); !status.ok()) {
    return Breach(kReadyChannel, status);
  }
  if (expect_ == Expect::kReady && ready_.episode == episode_) {
    return Answer(ready_, FrameType::kReady);
  }
  if (ready_.episode >= 0 && ready_.episode <= episode_) return LateCopy();
  return WrongAnswer(absl::StrCat("was ready for episode ", ready_.episode, " while episode ",
                                  episode_, " was asked"));
}

Disposition Inbox::TakeAction(std::span<const std::byte> payload) {
  if (absl::Status status = DecodeAction(payload, action_size_, scratch_, action_);
      !status.ok()) {
    return Breach(kActionChannel, status);
  }
  return TakeStep(action_, FrameType::kAction);
}

Disposition Inbox::TakeGiveUp(std::span<const std::byte> payload) {
  if (absl::Status status = DecodeGiveUp(payload, give_up_); !status.ok()) {
    return Breach(kGiveUpChannel, status);
  }
  return TakeStep(give_up_, FrameType::kGiveUp);
}

// An answer to a step, of either kind.
template <typename F>
Disposition Inbox::TakeStep(F& frame, FrameType type) {
  const auto answered = std::tie(frame.episode, frame.step);
  const auto asked = std::tie(episode_, step_);
  if (expect_ == Expect::kAction && answered == asked) return Answer(frame, type);
  if (frame.episode >= 0 && frame.step >= 0 && answered <= asked) return LateCopy();
  const std::string now = step_ < 0 ? absl::StrCat("no step")
                                    : absl::StrCat("step ", step_, " of episode ", episode_);
  return WrongAnswer(absl::StrCat("answered step ", frame.step, " of episode ", frame.episode,
                                  " while ", now, " was asked"));
}

Disposition Inbox::Stray() {
  if (++stray_ <= limits_.stray_messages) return Disposition::kDropped;
  return Fault(BridgeFault::kStrayLimit, stray_,
               absl::StrCat("sent ", stray_, " messages that answer nothing, more than the ",
                            limits_.stray_messages, " that an episode allows"));
}

Disposition Inbox::LateCopy() {
  if (free_duplicates_ == 0) return Stray();
  --free_duplicates_;
  return Disposition::kDropped;
}

Disposition Inbox::WrongAnswer(const std::string& sentence) {
  if (++wrong_ <= limits_.wrong_answers) return Disposition::kDropped;
  return Fault(BridgeFault::kProtocol, wrong_, absl::StrCat(sentence, ", ", wrong_, " times"));
}

Disposition Inbox::Breach(std::string_view channel, const absl::Status& status) {
  return Fault(BridgeFault::kProtocol, 0,
               absl::StrCat("sent a wrong message on ", View(channel), ": ", status.message()));
}

Disposition Inbox::Fault(BridgeFault fault, int64_t value, std::string_view sentence) {
  faulted_ = true;
  expect_ = Expect::kNothing;
  fault_ = MakeFault(fault, value, sentence);
  frame_ = BytesOf(fault_);
  return Disposition::kFault;
}

template <typename F>
Disposition Inbox::Answer(F& frame, FrameType type) {
  expect_ = Expect::kNothing;
  frame.header = MakeHeader<F>(type);
  frame_ = BytesOf(frame);
  return Disposition::kFrame;
}

}  // namespace myograde::bridge
