// What a hostile participant can put on the bus, tested on the inbox alone: every packet costs a
// bounded amount of work and no memory, nothing wrong is accepted, and the right answer still is.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/bridge/inbox.h"
#include "protocol/policy/channels.h"
#include "tests/protocol/bridge/messages.h"

namespace myograde::bridge {
namespace {

using ::testing::HasSubstr;

constexpr InboxLimits kLimits = {.stray_messages = 20, .wrong_answers = 15};
constexpr InboxLimits kWide = {.stray_messages = 1'000'000'000, .wrong_answers = 1'000'000'000};

// A fragment of a long message as LCM's header has it.
Packet Fragment(uint32_t message_size, uint32_t offset, uint16_t number, uint16_t count,
                size_t bytes = 16) {
  Packet packet;
  const auto put = [&](uint64_t value, int size) {
    for (int i = size; i-- > 0;) packet.push_back(static_cast<std::byte>(value >> (8 * i)));
  };
  put(0x4c433033, 4);  // "LC03"
  put(1, 4);
  put(message_size, 4);
  put(offset, 4);
  put(number, 2);
  put(count, 2);
  if (number == 0) {
    for (const char c : kActionChannel) packet.push_back(static_cast<std::byte>(c));
    packet.push_back(std::byte{0});
  }
  packet.resize(packet.size() + bytes, std::byte{0x41});
  return packet;
}

// An inbox that waits for a step's action.
Inbox AtStep(int64_t episode, int64_t step, InboxLimits limits = kLimits) {
  Inbox inbox(limits);
  EXPECT_EQ(inbox.Take(Wrap(kHelloChannel, Encode(GoodHello()))), Disposition::kFrame);
  inbox.Ask(Question(Channel::kWelcome, Expect::kNothing, -1, -1));
  inbox.Ask(Question(Channel::kEpisodeStart, Expect::kReady, episode, -1));
  EXPECT_EQ(inbox.Take(Wrap(kReadyChannel, Encode(GoodReady(episode)))), Disposition::kFrame);
  inbox.Ask(Question(Channel::kObservation, Expect::kAction, episode, step));
  return inbox;
}

bool Answers(Inbox& inbox, int64_t episode, int64_t step) {
  if (inbox.Take(Wrap(kActionChannel, Encode(GoodAction(episode, step)))) != Disposition::kFrame) {
    return false;
  }
  const auto frame = ParseBridgeFrame(inbox.frame());
  const auto* action = frame.ok() ? std::get_if<ActionFrame>(&*frame) : nullptr;
  return action != nullptr && action->episode == episode && action->step == step;
}

int64_t ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  int64_t all = 0, resident = 0;
  file >> all >> resident;
  return resident * ::sysconf(_SC_PAGESIZE);
}

std::string FaultText(const Inbox& inbox) {
  FaultFrame frame;
  if (inbox.frame().size() != sizeof(frame)) return "no fault";
  std::memcpy(&frame, inbox.frame().data(), sizeof(frame));
  return frame.detail;
}

TEST(InboxAttack, FragmentsTakeNoMemoryWhateverTheyClaim) {
  Inbox inbox = AtStep(0, 0, kWide);
  const std::vector<Packet> packets = {
      Fragment(1u << 28, 0, 0, 4096),            // 256 MiB claimed
      Fragment(0xffffffff, 0, 0, 0xffff),        // 4 GiB claimed
      Fragment(64, 0xfffffff0, 1, 2),            // an offset that wraps to before the buffer
      Fragment(0, 0xffffffff, 0, 0, 1000),       // claims nothing, sends a lot
      Fragment(1u << 20, 0, 0, 20, 60'000),      // started and never finished
  };
  const int64_t before = ResidentBytes();
  for (int i = 0; i < 1000; ++i) {
    for (const Packet& packet : packets) ASSERT_EQ(inbox.Take(packet), Disposition::kDropped);
  }
  EXPECT_LT(ResidentBytes() - before, 16 << 20);
  EXPECT_TRUE(Answers(inbox, 0, 0));
}

TEST(InboxAttack, FragmentsOfEveryFormAreStrays) {
  EXPECT_TRUE(rc::check([](uint32_t size, uint32_t offset, uint16_t number, uint16_t count, uint8_t bytes) {
    Inbox inbox = AtStep(0, 0);
    const Packet packet = Fragment(size, offset, number, count, bytes);
    for (int64_t i = 0; i < kLimits.stray_messages; ++i) {
      RC_ASSERT(inbox.Take(packet) == Disposition::kDropped);
    }
    RC_ASSERT(inbox.waiting());
    RC_ASSERT(inbox.Take(packet) == Disposition::kFault);
  }));
}

TEST(InboxAttack, LcmsOwnSequenceNumbersMeanNothing) {
  // Two publishers, replayed and false answers: only episode and step count.
  EXPECT_TRUE(rc::check([](const std::vector<uint32_t>& sequences) {
    Inbox inbox(kWide);
    inbox.Take(Wrap(kHelloChannel, Encode(GoodHello())));
    inbox.Ask(Question(Channel::kEpisodeStart, Expect::kReady, 0, -1));
    inbox.Take(Wrap(kReadyChannel, Encode(GoodReady(0))));
    int64_t step = 0;
    for (const uint32_t sequence : sequences) {
      inbox.Ask(Question(Channel::kObservation, Expect::kAction, 0, step));
      const Packet packet = Wrap(kActionChannel, Encode(GoodAction(0, step)), sequence);
      RC_ASSERT(inbox.Take(packet) == Disposition::kFrame);
      RC_ASSERT(inbox.Take(packet) == Disposition::kDropped);
      ++step;
    }
  }));
}

TEST(InboxAttack, OnlyTheAskedStepIsAnsweredWhateverIsSentBefore) {
  EXPECT_TRUE(rc::check([](const std::vector<std::pair<int8_t, int8_t>>& answers) {
    constexpr int64_t kEpisode = 3, kStep = 7;
    Inbox inbox = AtStep(kEpisode, kStep, kWide);
    for (const auto& [episode, step] : answers) {
      if (episode == kEpisode && step == kStep) continue;
      RC_ASSERT(inbox.Take(Wrap(kActionChannel, Encode(GoodAction(episode, step)))) ==
                Disposition::kDropped);
      RC_ASSERT(inbox.waiting());
    }
    RC_ASSERT(Answers(inbox, kEpisode, kStep));
    RC_ASSERT(!inbox.waiting());
  }));
}

TEST(InboxAttack, OutOfRangeEpisodesAndStepsAreNoAnswers) {
  constexpr int64_t kLow = std::numeric_limits<int64_t>::min();
  constexpr int64_t kHigh = std::numeric_limits<int64_t>::max();
  Inbox inbox = AtStep(0, 0, kWide);
  for (const int64_t episode : {kLow, int64_t{-1}, int64_t{0}, kHigh}) {
    for (const int64_t step : {kLow, int64_t{-1}, int64_t{1}, kHigh}) {
      EXPECT_EQ(inbox.Take(Wrap(kActionChannel, Encode(GoodAction(episode, step)))),
                Disposition::kDropped);
    }
    if (episode != 0) {
      EXPECT_FALSE(Answers(inbox, episode, 0));
    }
    EXPECT_EQ(inbox.Take(Wrap(kReadyChannel, Encode(GoodReady(episode)))), Disposition::kDropped);
  }
  EXPECT_TRUE(Answers(inbox, 0, 0));
}

// Overwrites four bytes of a message with a number, as a count.
Packet WithNumber(Packet packet, size_t at, int32_t number) {
  for (int i = 0; i < 4; ++i) {
    packet[at + static_cast<size_t>(i)] =
        static_cast<std::byte>(static_cast<uint32_t>(number) >> (24 - 8 * i));
  }
  return packet;
}

TEST(InboxAttack, CountsAndLengthsAreCheckedBeforeAnythingIsTaken) {
  const Packet action = Encode(GoodAction(0, 0));
  const Packet hello = Encode(GoodHello());
  const Packet ready = Encode(GoodReady(0));
  const int64_t before = ResidentBytes();
  for (const int32_t number : {-1, std::numeric_limits<int32_t>::min(), 81, 1 << 28,
                               std::numeric_limits<int32_t>::max()}) {
    // After fingerprint, episode and step: the action's size.
    Inbox one = AtStep(0, 0);
    EXPECT_EQ(one.Take(Wrap(kActionChannel, WithNumber(action, 24, number))), Disposition::kFault);
    EXPECT_THAT(FaultText(one), HasSubstr("entries, must have 55"));
    // After fingerprint and version: the name's length; at the end: the number of leg sets.
    for (const size_t at : {size_t{12}, hello.size() - 4}) {
      Inbox two(kLimits);
      EXPECT_EQ(two.Take(Wrap(kHelloChannel, WithNumber(hello, at, number))), Disposition::kFault);
    }
    Inbox three(kLimits);
    three.Ask(Question(Channel::kEpisodeStart, Expect::kReady, 0, -1));
    EXPECT_EQ(three.Take(Wrap(kReadyChannel, WithNumber(ready, ready.size() - 4, number))),
              Disposition::kFault);
    EXPECT_THAT(FaultText(three), HasSubstr("num_leg_sets"));
  }
  EXPECT_LT(ResidentBytes() - before, 16 << 20);
  // A name of length 0 lacks even its NUL.
  Inbox empty(kLimits);
  EXPECT_EQ(empty.Take(Wrap(kHelloChannel, WithNumber(hello, 12, 0))), Disposition::kFault);
  EXPECT_THAT(FaultText(empty), HasSubstr("name"));
  // An empty name is valid: only its NUL.
  hello_t nameless = GoodHello();
  nameless.name.clear();
  Inbox allowed(kLimits);
  EXPECT_EQ(allowed.Take(Wrap(kHelloChannel, Encode(nameless))), Disposition::kFrame);
}

TEST(InboxAttack, EveryOtherFingerprintIsRefused) {
  EXPECT_TRUE(rc::check([](uint64_t fingerprint) {
    const Packet good = Encode(GoodAction(0, 0));
    Packet packet = good;
    for (size_t i = 0; i < 8; ++i) packet[i] = static_cast<std::byte>(fingerprint >> (56 - 8 * i));
    RC_PRE(packet != good);
    Inbox inbox = AtStep(0, 0);
    RC_ASSERT(inbox.Take(Wrap(kActionChannel, packet)) == Disposition::kFault);
  }));
  // Valid messages on each other's channels.
  Inbox inbox = AtStep(0, 0);
  EXPECT_EQ(inbox.Take(Wrap(kActionChannel, Encode(GoodHello()))), Disposition::kFault);
  EXPECT_THAT(FaultText(inbox), HasSubstr("fingerprint"));
}

TEST(InboxAttack, NumbersThatAreNoneNeverPassAndHugeOnesDo) {
  EXPECT_TRUE(rc::check([] {
    const size_t at = *rc::gen::inRange<size_t>(0, 55);
    const uint64_t bits = *rc::gen::arbitrary<uint64_t>();
    const bool none = *rc::gen::arbitrary<bool>();
    action_t action = GoodAction(0, 0);
    // All exponent bits set: infinities and every NaN.
    const uint64_t chosen = none ? bits | 0x7ff0000000000000u : bits;
    std::memcpy(&action.values[at], &chosen, sizeof(chosen));
    Inbox inbox = AtStep(0, 0);
    const Disposition verdict = inbox.Take(Wrap(kActionChannel, Encode(action)));
    RC_ASSERT(verdict == (std::isfinite(action.values[at]) ? Disposition::kFrame : Disposition::kFault));
  }));
  for (const double number : {1e308, -1e308, 5e-324, -0.0}) {
    action_t action = GoodAction(0, 0);
    action.values[0] = number;
    Inbox inbox = AtStep(0, 0);
    ASSERT_EQ(inbox.Take(Wrap(kActionChannel, Encode(action))), Disposition::kFrame);
    const auto frame = ParseBridgeFrame(inbox.frame());
    ASSERT_TRUE(frame.ok()) << frame.status();
    EXPECT_EQ(std::get<ActionFrame>(*frame).values[0], number);
  }
}

TEST(InboxAttack, AnswersBeforeAQuestionEndAtTheLimit) {
  Inbox inbox(kLimits);
  ASSERT_EQ(inbox.Take(Wrap(kHelloChannel, Encode(GoodHello()))), Disposition::kFrame);
  int64_t taken = 0;
  while (inbox.Take(Wrap(kActionChannel, Encode(GoodAction(0, taken)))) == Disposition::kDropped) {
    ASSERT_LE(++taken, kLimits.wrong_answers);
  }
  EXPECT_EQ(taken, kLimits.wrong_answers);
}

TEST(InboxAttack, AFloodOfAnythingEndsInAFaultOrCostsLittle) {
  EXPECT_TRUE(rc::check([](const std::vector<uint8_t>& noise, bool short_message) {
    Inbox inbox = AtStep(0, 0);
    Packet packet = short_message ? Wrap("ANYTHING", {}) : Packet();
    for (const uint8_t byte : noise) packet.push_back(static_cast<std::byte>(byte));
    int64_t taken = 0;
    while (inbox.Take(packet) != Disposition::kFault) RC_ASSERT(++taken <= kLimits.stray_messages);
    RC_ASSERT(!inbox.waiting());
  }));
  // A second's flood of the largest packets is handled in less than a second.
  Inbox inbox = AtStep(0, 0, kWide);
  Packet large = Wrap("FLOOD", Packet(65'000));
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 10'000; ++i) ASSERT_EQ(inbox.Take(large), Disposition::kDropped);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(1));
  EXPECT_TRUE(Answers(inbox, 0, 0));
}

TEST(InboxAttack, ASecondPublisherCannotChangeAnAnswer) {
  Inbox inbox = AtStep(0, 0);
  ASSERT_TRUE(Answers(inbox, 0, 0));
  const Packet first(inbox.frame().begin(), inbox.frame().end());
  action_t other = GoodAction(0, 0);
  std::fill(other.values.begin(), other.values.end(), -1.0);
  EXPECT_EQ(inbox.Take(Wrap(kActionChannel, Encode(other))), Disposition::kDropped);
  // The next step is answered only by an answer to its own question.
  inbox.Ask(Question(Channel::kObservation, Expect::kAction, 0, 1));
  EXPECT_EQ(inbox.Take(Wrap(kActionChannel, Encode(other))), Disposition::kDropped);
  EXPECT_TRUE(Answers(inbox, 0, 1));
  EXPECT_NE(Packet(inbox.frame().begin(), inbox.frame().end()), first);
}

}  // namespace
}  // namespace myograde::bridge
