// A whole conversation at the bridge: the simulator's questions and a participant's datagrams in
// any order. Every question gets at most one answer, every answer fits its question, and every
// flood is stopped.
#include <array>
#include <cstring>
#include <memory>

#include "protocol/bridge/inbox.h"
#include "protocol/policy/channels.h"
#include "tests/fuzz/fuzz.h"
#include "tests/protocol/bridge/messages.h"

using namespace myograde;
using namespace myograde::bridge;
using fuzz::Require;

namespace {

constexpr InboxLimits kLimits = {.stray_messages = 12, .wrong_answers = 7};
constexpr std::array kChannels = {kHelloChannel,   kReadyChannel,       kActionChannel,
                                  kWelcomeChannel, kObservationChannel, std::string_view("OTHER"),
                                  kGiveUpChannel};
constexpr int kActionSize = 3;

// A well-formed message whose numbers the input chooses.
Packet GoodMessage(fuzz::Input& input) {
  switch (input.Byte() % 4) {
    case 0: {
      hello_t hello = GoodHello();
      hello.direct = static_cast<int8_t>(input.Byte() & 1);
      return Wrap(kHelloChannel, Encode(hello));
    }
    case 1:
      return Wrap(kReadyChannel, Encode(GoodReady(static_cast<int8_t>(input.Byte()))));
    case 3: {
      const int64_t episode = static_cast<int8_t>(input.Byte());
      return Wrap(kGiveUpChannel, Encode(GivingUp(episode, static_cast<int8_t>(input.Byte()))));
    }
    default: {
      action_t action = GoodAction(static_cast<int8_t>(input.Byte()), 0, kActionSize);
      action.step = static_cast<int8_t>(input.Byte());
      action.values = {0.5, -1, 1e308};
      return Wrap(kActionChannel, Encode(action));
    }
  }
}

class Conversation {
 public:
  void Ask(fuzz::Input& input) {
    std::memset(&question_, 0, offsetof(PublishFrame, payload));
    const uint8_t kind = input.Byte();
    question_.channel = static_cast<Channel>(kind % 4);
    question_.expect = question_.channel == Channel::kEpisodeStart  ? Expect::kReady
                       : question_.channel == Channel::kObservation ? Expect::kAction
                                                                    : Expect::kNothing;
    question_.episode = input.Byte();
    question_.step = question_.channel == Channel::kObservation ? input.Byte() : -1;
    question_.action_size = question_.channel == Channel::kObservation ? kActionSize : 0;
    inbox_.Ask(question_);
    answered_ = question_.expect == Expect::kNothing;
    asked_ = true;
    messages_ = 0;
  }

  void AskAgain() {
    inbox_.AskedAgain();
    ++again_;
  }

  void Take(const Packet& packet) {
    const bridge::Disposition verdict = inbox_.Take(packet);
    Require(!faulted_ || verdict == bridge::Disposition::kDropped, "after a fault nothing is taken");
    ++messages_;
    if (verdict == bridge::Disposition::kFrame || verdict == bridge::Disposition::kFault) Check(verdict);
    if (verdict == bridge::Disposition::kFault) faulted_ = true;
    // Every message but the answer uses up one of the allowances.
    Require(faulted_ || messages_ <= 1 + kLimits.stray_messages + kLimits.wrong_answers + 1 +
                                         again_,
            "a flood ends in a fault");
  }

 private:
  void Check(bridge::Disposition verdict) {
    const auto frame = ParseBridgeFrame(inbox_.frame());
    Require(frame.ok(), "the simulator takes the frame");
    Require(std::holds_alternative<FaultFrame>(*frame) == (verdict == bridge::Disposition::kFault),
            "a fault is told as a fault");
    if (verdict == bridge::Disposition::kFault) return;
    if (std::holds_alternative<HelloFrame>(*frame)) {
      Require(!greeted_, "there is one hello");
      greeted_ = true;
      return;
    }
    Require(asked_ && !answered_, "a question has one answer");
    answered_ = true;
    if (const auto* ready = std::get_if<ReadyFrame>(&*frame)) {
      Require(question_.expect == Expect::kReady && ready->episode == question_.episode,
              "a ready answers its start");
    }
    if (const auto* action = std::get_if<ActionFrame>(&*frame)) {
      Require(question_.expect == Expect::kAction && action->episode == question_.episode &&
                  action->step == question_.step && action->size == uint32_t{kActionSize},
              "an action answers its observation");
    }
    if (const auto* give_up = std::get_if<GiveUpFrame>(&*frame)) {
      Require(question_.expect == Expect::kAction && give_up->episode == question_.episode &&
                  give_up->step == question_.step,
              "giving up answers its observation");
    }
    Require(!inbox_.waiting(), "an answer ends the waiting");
  }

  Inbox inbox_{kLimits};
  PublishFrame question_;
  bool asked_ = false;
  bool answered_ = false;
  bool greeted_ = false;
  bool faulted_ = false;
  int64_t messages_ = 0;  // since the last question
  int64_t again_ = 0;     // total number of repeated questions
};

}  // namespace

MYOGRADE_FUZZ_TARGET(inbox)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const auto conversation = std::make_unique<Conversation>();
  while (!input.empty()) {
    switch (input.Byte() % 6) {
      case 0:
      case 1:
        conversation->Ask(input);
        break;
      case 2:
        conversation->AskAgain();
        break;
      case 3:
        conversation->Take(GoodMessage(input));
        break;
      case 4: {
        const std::string_view channel = kChannels[input.Byte() % kChannels.size()];
        const auto payload = input.Bytes(input.Byte());
        conversation->Take(Wrap(channel, Packet(payload.begin(), payload.end())));
        break;
      }
      default: {
        const auto raw = input.Bytes(input.Byte());
        conversation->Take(Packet(raw.begin(), raw.end()));
        break;
      }
    }
  }
  return 0;
}
