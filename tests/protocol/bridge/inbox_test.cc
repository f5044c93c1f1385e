#include "protocol/bridge/inbox.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/policy/channels.h"
#include "protocol/bridge/leg_sets_json.h"
#include "tests/protocol/bridge/messages.h"

namespace myograde::bridge {
namespace {

using ::testing::HasSubstr;

leg_parameter_set_t LegSet(int8_t index) {
  leg_parameter_set_t set;
  set.index = index;
  for (leg_state_t& state : set.states) {
    state = {100, 5, 0.1, 200, 6, 0.2, 1, {}};
    state.thresholds.push_back({0, 1, 30.0});
  }
  return set;
}

class InboxTest : public ::testing::Test {
 protected:
  // Completes the handshake, up to the steps of episode 0.
  void Begin() {
    EXPECT_EQ(Take(kHelloChannel, GoodHello()), Disposition::kFrame);
    inbox_.Ask(Question(Channel::kWelcome, Expect::kNothing, -1, -1));
    Start(0);
  }
  void Start(int64_t episode) {
    inbox_.Ask(Question(Channel::kEpisodeStart, Expect::kReady, episode, -1));
    EXPECT_EQ(Take(kReadyChannel, GoodReady(episode)), Disposition::kFrame);
  }
  void AskStep(int64_t episode, int64_t step) {
    inbox_.Ask(Question(Channel::kObservation, Expect::kAction, episode, step));
  }
  template <typename Message>
  Disposition Take(std::string_view channel, const Message& message) {
    return inbox_.Take(Wrap(channel, Encode(message)));
  }
  std::string Fault() const {
    FaultFrame frame;
    if (inbox_.frame().size() != sizeof(frame)) return "no fault";
    std::memcpy(&frame, inbox_.frame().data(), sizeof(frame));
    return frame.detail;
  }

  Inbox inbox_{{.stray_messages = 20, .wrong_answers = 15}};
};

TEST_F(InboxTest, AnswersBecomeFramesThatTheSimulatorTakes) {
  Begin();
  AskStep(0, 0);
  EXPECT_TRUE(inbox_.waiting());
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kFrame);
  EXPECT_FALSE(inbox_.waiting());
  const auto frame = ParseBridgeFrame(inbox_.frame());
  ASSERT_TRUE(frame.ok()) << frame.status();
  const auto& action = std::get<ActionFrame>(*frame);
  EXPECT_EQ(action.size, 55u);
  EXPECT_EQ(action.values[54], 0.25);
}

TEST_F(InboxTest, AStepIsAnsweredByGivingUpToo) {
  Begin();
  AskStep(0, 3);
  ASSERT_EQ(Take(kGiveUpChannel, GivingUp(0, 3)), Disposition::kFrame);
  EXPECT_FALSE(inbox_.waiting());
  const auto frame = ParseBridgeFrame(inbox_.frame());
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(std::get<GiveUpFrame>(*frame).episode, 0);
  EXPECT_EQ(std::get<GiveUpFrame>(*frame).step, 3);
  // The first answer won; an action after it is an ordinary copy.
  EXPECT_EQ(Take(kActionChannel, GoodAction(0, 3)), Disposition::kDropped);
  Start(1);
  AskStep(1, 0);
  EXPECT_EQ(Take(kActionChannel, GoodAction(1, 0)), Disposition::kFrame);
}

TEST_F(InboxTest, GivingUpWhatWasNotAskedIsAWrongAnswer) {
  Begin();
  for (int i = 0; i < 15; ++i) ASSERT_EQ(Take(kGiveUpChannel, GivingUp(0, 0)), Disposition::kDropped);
  EXPECT_EQ(Take(kGiveUpChannel, GivingUp(0, 0)), Disposition::kFault);
  EXPECT_THAT(Fault(), HasSubstr("answered step 0 of episode 0 while no step was asked"));
}

TEST_F(InboxTest, AMalformedGivingUpIsABreach) {
  for (const size_t size : {0u, 7u, 23u, 25u}) {
    Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
    Packet payload = Encode(GivingUp(0, 0));
    payload.resize(size);
    EXPECT_EQ(inbox.Take(Wrap(kGiveUpChannel, payload)), Disposition::kFault) << size;
  }
  EXPECT_EQ(Take(kGiveUpChannel, GoodReady(0)), Disposition::kFault);
  EXPECT_THAT(Fault(), HasSubstr("MYOGRADE_GIVE_UP"));
}

TEST_F(InboxTest, TheFirstValidAnswerWins) {
  Begin();
  AskStep(0, 0);
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kFrame);
  EXPECT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kDropped);
}

TEST_F(InboxTest, HelloCarriesConventionAndLegSets) {
  hello_t hello = GoodHello();
  hello.direct = 1;
  hello.leg_sets = {LegSet(2)};
  hello.num_leg_sets = 1;
  ASSERT_EQ(Take(kHelloChannel, hello), Disposition::kFrame);
  const auto frame = ParseBridgeFrame(inbox_.frame());
  ASSERT_TRUE(frame.ok()) << frame.status();
  const auto& greeting = std::get<HelloFrame>(*frame);
  EXPECT_EQ(greeting.convention, ActionConvention::kDirect);
  const auto sets = LegSetsFromJson(
      nlohmann::json::parse(std::string(greeting.parameters.text, greeting.parameters.size)));
  ASSERT_TRUE(sets.ok()) << sets.status();
  EXPECT_EQ(sets->present, 4u);
  EXPECT_EQ(sets->set[2][3].ankle_stiffness, 200);
  EXPECT_EQ(sets->set[2][3].threshold[0], 30);
  EXPECT_EQ(sets->set[2][3].threshold_kind[0], 1);
}

TEST_F(InboxTest, ANameWithoutItsEndingZeroIsABreach) {
  Packet payload = Encode(GoodHello());
  // Fingerprint, version and length come first; the length includes the NUL.
  const size_t zero = 8 + 4 + 4 + std::string_view("test").size();
  ASSERT_EQ(payload[zero], std::byte{0});
  payload[zero] = std::byte{'x'};
  EXPECT_EQ(inbox_.Take(Wrap(kHelloChannel, payload)), Disposition::kFault);
  EXPECT_THAT(Fault(), HasSubstr("no ending zero byte"));
}

TEST_F(InboxTest, ALaterHelloAsksForTheWelcomeAgainUntilItIsAFlood) {
  ASSERT_EQ(Take(kHelloChannel, GoodHello()), Disposition::kFrame);
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(Take(kHelloChannel, GoodHello()), Disposition::kResendWelcome) << i;
  }
  EXPECT_EQ(Take(kHelloChannel, GoodHello()), Disposition::kFault);
}

TEST_F(InboxTest, LateCopiesAreFreeAsOftenAsWasAsked) {
  Begin();
  AskStep(0, 0);
  for (int i = 0; i < 30; ++i) inbox_.AskedAgain();
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kFrame);
  for (int i = 0; i < 30; ++i) {
    ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kDropped) << i;
  }
  // From here on they count as strays: 20 are allowed.
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kDropped) << i;
  }
  EXPECT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kFault);
}

TEST_F(InboxTest, AnswersToStepsNeverAskedAreCounted) {
  Begin();
  AskStep(0, 8);
  for (int i = 0; i < 15; ++i) {
    ASSERT_EQ(Take(kActionChannel, GoodAction(0, 9)), Disposition::kDropped) << i;
  }
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 9)), Disposition::kFault);
  EXPECT_EQ(Fault(), "answered step 9 of episode 0 while step 8 of episode 0 was asked, 16 times");
}

TEST_F(InboxTest, ANewEpisodeCountsAfresh) {
  Begin();
  AskStep(0, 0);
  for (int i = 0; i < 15; ++i) ASSERT_EQ(Take(kActionChannel, GoodAction(7, 0)), Disposition::kDropped);
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(inbox_.Take(Wrap("SOMETHING_ELSE", {})), Disposition::kDropped);
  }
  Start(1);
  AskStep(1, 0);
  EXPECT_EQ(Take(kActionChannel, GoodAction(7, 0)), Disposition::kDropped);
  EXPECT_EQ(inbox_.Take(Wrap("SOMETHING_ELSE", {})), Disposition::kDropped);
  EXPECT_EQ(Take(kActionChannel, GoodAction(1, 0)), Disposition::kFrame);
}

TEST_F(InboxTest, AnAnswerBeforeAnyStepIsWrong) {
  Begin();
  for (int i = 0; i < 15; ++i) ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kDropped);
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0)), Disposition::kFault);
  EXPECT_THAT(Fault(), HasSubstr("while no step was asked"));
}

class ActionSizeTest : public InboxTest, public ::testing::WithParamInterface<int> {};

TEST_P(ActionSizeTest, AnActionOfAnotherSizeIsABreach) {
  Begin();
  AskStep(0, 0);
  ASSERT_EQ(Take(kActionChannel, GoodAction(0, 0, GetParam())), Disposition::kFault);
  EXPECT_THAT(Fault(), HasSubstr(absl::StrCat("has ", GetParam(), " entries, must have 55")));
}

INSTANTIATE_TEST_SUITE_P(Sizes, ActionSizeTest, ::testing::Values(0, 54, 56, 79, 80, 81, 1000));

TEST_F(InboxTest, NumbersThatAreNoneAreABreach) {
  Begin();
  AskStep(0, 0);
  action_t action = GoodAction(0, 0);
  action.values[3] = std::numeric_limits<double>::quiet_NaN();
  ASSERT_EQ(Take(kActionChannel, action), Disposition::kFault);
  EXPECT_EQ(
      Fault(),
      "sent a wrong message on MYOGRADE_ACTION: entry 3 of the action is not a finite number");
}

TEST_F(InboxTest, InfinityIsABreachToo) {
  Begin();
  AskStep(0, 0);
  action_t action = GoodAction(0, 0);
  action.values[54] = -std::numeric_limits<double>::infinity();
  EXPECT_EQ(Take(kActionChannel, action), Disposition::kFault);
}

TEST_F(InboxTest, TheGradersOwnChannelsAreForbidden) {
  for (const std::string_view channel :
       {kWelcomeChannel, kStartChannel, kObservationChannel, kEndChannel}) {
    Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
    EXPECT_EQ(inbox.Take(Wrap(channel, {})), Disposition::kFault) << channel;
  }
}

TEST_F(InboxTest, StraysAreCounted) {
  for (int i = 0; i < 10; ++i) {
    ASSERT_EQ(inbox_.Take(Wrap("LCM_SELF_TEST", {})), Disposition::kDropped);
    ASSERT_EQ(inbox_.Take(Packet(30, std::byte{'x'})), Disposition::kDropped);
  }
  ASSERT_EQ(inbox_.Take(Packet(30, std::byte{'x'})), Disposition::kFault);
  FaultFrame frame;
  std::memcpy(&frame, inbox_.frame().data(), sizeof(frame));
  EXPECT_EQ(frame.fault, BridgeFault::kStrayLimit);
  EXPECT_EQ(frame.value, 21);
}

TEST_F(InboxTest, NothingIsTakenAfterAFault) {
  ASSERT_EQ(inbox_.Take(Wrap(kWelcomeChannel, {})), Disposition::kFault);
  EXPECT_EQ(Take(kHelloChannel, GoodHello()), Disposition::kDropped);
  EXPECT_EQ(inbox_.Take(Wrap(kWelcomeChannel, {})), Disposition::kDropped);
}

// Every truncation of a valid message, and every single-byte change, gives a frame that the
// simulator accepts, or a fault; never anything else, never a crash.
template <typename Message>
void Mutilate(std::string_view channel, const Message& message) {
  const Packet good = Encode(message);
  for (size_t size = 0; size < good.size(); ++size) {
    Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
    const Packet cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(inbox.Take(Wrap(channel, cut)), Disposition::kFault) << size;
  }
  Inbox longer({.stray_messages = 20, .wrong_answers = 15});
  Packet more = good;
  more.push_back(std::byte{0});
  EXPECT_EQ(longer.Take(Wrap(channel, more)), Disposition::kFault);
  for (size_t at = 0; at < good.size(); ++at) {
    for (const int value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Packet changed = good;
      changed[at] = static_cast<std::byte>(value);
      Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
      if (inbox.Take(Wrap(channel, changed)) == Disposition::kFrame) {
        EXPECT_TRUE(ParseBridgeFrame(inbox.frame()).ok()) << at << " " << value;
      }
    }
  }
}

TEST_F(InboxTest, MutilatedMessagesAreHarmless) {
  hello_t hello = GoodHello();
  hello.leg_sets = {LegSet(0), LegSet(4)};
  hello.num_leg_sets = 2;
  Mutilate(kHelloChannel, hello);
  Mutilate(kActionChannel, GoodAction(0, 0));
  episode_ready_t ready;
  ready.episode = 0;
  ready.leg_sets = {LegSet(1)};
  ready.num_leg_sets = 1;
  Mutilate(kReadyChannel, ready);
}

TEST_F(InboxTest, LegSetsAreCheckedInForm) {
  const auto problem = [](auto&& change) {
    hello_t hello = GoodHello();
    hello.leg_sets = {LegSet(0), LegSet(1)};
    change(hello.leg_sets[1]);
    hello.num_leg_sets = 2;
    Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
    if (inbox.Take(Wrap(kHelloChannel, Encode(hello))) != Disposition::kFault) {
      return std::string("none");
    }
    FaultFrame frame;
    std::memcpy(&frame, inbox.frame().data(), sizeof(frame));
    return std::string(frame.detail);
  };
  EXPECT_EQ(problem([](auto&) {}), "none");
  EXPECT_THAT(problem([](auto& set) { set.index = 0; }), HasSubstr("there twice"));
  EXPECT_THAT(problem([](auto& set) { set.index = 5; }), HasSubstr("leg set index 5"));
  EXPECT_THAT(problem([](auto& set) { set.index = -1; }), HasSubstr("leg set index -1"));
  EXPECT_THAT(problem([](auto& set) { set.states[2].knee_damping = NAN; }),
              HasSubstr("leg set 1, state 2: a number is not finite"));
  EXPECT_THAT(problem([](auto& set) { set.states[2].thresholds[0].quantity = 5; }),
              HasSubstr("quantity 5"));
  EXPECT_THAT(problem([](auto& set) { set.states[2].thresholds[0].above = 2; }),
              HasSubstr("above must be 0 or 1"));
  EXPECT_THAT(problem([](auto& set) {
                set.states[0].thresholds.clear();
                set.states[0].num_thresholds = 0;
              }),
              HasSubstr("num_thresholds is 0"));
  EXPECT_THAT(problem([](auto& set) {
                set.states[0].thresholds.assign(6, {0, 1, 1.0});
                set.states[0].num_thresholds = 6;
              }),
              HasSubstr("num_thresholds is 6"));
}

TEST_F(InboxTest, RandomPayloadsOnKnownChannelsAreHarmless) {
  EXPECT_TRUE(rc::check([](const std::vector<uint8_t>& noise, bool fingerprint, uint8_t which) {
    const std::array channels = {kHelloChannel, kReadyChannel, kActionChannel};
    const std::array<int64_t, 3> hashes = {hello_t::getHash(), episode_ready_t::getHash(),
                                           action_t::getHash()};
    Packet payload;
    if (fingerprint) {
      const auto hash = static_cast<uint64_t>(hashes[which % 3]);
      for (int i = 7; i >= 0; --i) payload.push_back(static_cast<std::byte>(hash >> (8 * i)));
    }
    for (const uint8_t byte : noise) payload.push_back(static_cast<std::byte>(byte));
    Inbox inbox({.stray_messages = 20, .wrong_answers = 15});
    inbox.Ask(Question(Channel::kObservation, Expect::kAction, 0, 0));
    if (inbox.Take(Wrap(channels[which % 3], payload)) == Disposition::kFrame) {
      RC_ASSERT(ParseBridgeFrame(inbox.frame()).ok());
    }
  }));
}

TEST(MakeFault, TextIsCutAndMadePrintable) {
  const FaultFrame frame =
      MakeFault(BridgeFault::kProtocol, 1, std::string("a\n\xff\x1b") + std::string(400, 'z'));
  const auto parsed = ParseBridgeFrame(std::as_bytes(std::span<const FaultFrame, 1>(&frame, 1)));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(std::string(frame.detail).substr(0, 5), "a???z");
}

}  // namespace
}  // namespace myograde::bridge
