// The episode loop without physics: an environment that counts, a policy's
// sandbox played by a thread on a socket pair, and a runner played by another.
#include "sim/episode/lease_player.h"

#include <sys/socket.h>

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "myograde/episode_start_t.hpp"
#include "myograde/observation_t.hpp"
#include "myograde/welcome_t.hpp"

namespace myograde::sim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::pair<Fd, Fd> Pair() {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) std::abort();
  return {Fd(ends[0]), Fd(ends[1])};
}

// Ends after `length` steps; its state is the seed and the actions' sums.
class CountingEnvironment : public Environment {
 public:
  void Reset(uint64_t seed) override {
    resets.push_back(seed);
    state_ = {static_cast<double>(seed), 0, 0};
    facts_ = {};
    sets_stored.clear();
  }
  absl::Status SetLegParameters(const LegParameterSets& sets) override {
    if (sets.present & 16u) return absl::InvalidArgumentError("leg set 4 is out of range");
    sets_stored.push_back(sets.present);
    return absl::OkStatus();
  }
  void SetConvention(ActionConvention convention) override { convention_used = convention; }
  int observation_size() const override { return 222; }
  int action_size() const override { return 80; }
  void Observe(std::span<double> out) const override {
    std::fill(out.begin(), out.end(), state_[1]);
    out[0] = state_[0];
  }
  StepResult Step(std::span<const double> action) override {
    ++facts_.steps;
    state_[1] += 1;
    state_[2] += action[79];
    std::get<ManipulationFacts>(facts_.track).effort_sum += unstable_at > 0 ? NAN : 0.5;
    facts_.end = EpisodeEnd::kTime;
    StepResult result;
    result.ended = facts_.steps == length;
    result.unstable = facts_.steps == unstable_at;
    result.overflow = facts_.steps == overflow_at;
    return result;
  }
  EpisodeFacts facts() const override { return facts_; }
  std::span<const double> state() const override { return state_; }

  int64_t length = 5;
  int64_t unstable_at = 0;
  int64_t overflow_at = 0;
  std::vector<uint64_t> resets;
  std::vector<uint32_t> sets_stored;
  ActionConvention convention_used = ActionConvention::kNormalized;

 private:
  std::array<double, 3> state_ = {};
  EpisodeFacts facts_;
};

// A sandbox as the simulator sees it: answers each question by `script`.
class Sandbox {
 public:
  explicit Sandbox(Fd socket) : socket_(std::move(socket)) {}

  template <typename F>
  void Send(F frame, FrameType type) {
    frame.header = MakeHeader<F>(type);
    (void)!send(socket_.get(), &frame, sizeof(frame), MSG_NOSIGNAL);
  }
  void Hello(uint32_t version = 1, uint32_t sets = 0) {
    HelloFrame frame = {};
    frame.protocol_version = version;
    frame.convention = ActionConvention::kDirect;
    frame.sets.present = sets;
    Send(frame, FrameType::kHello);
  }
  void Ready(int64_t episode, uint32_t sets = 0) {
    ReadyFrame frame = {};
    frame.episode = episode;
    frame.sets.present = sets;
    Send(frame, FrameType::kReady);
  }
  void Act(const PublishFrame& question, double value = 1) {
    ActionFrame frame = {};
    frame.episode = question.episode;
    frame.step = question.step;
    frame.size = 80;
    std::fill(std::begin(frame.values), std::end(frame.values), value);
    Send(frame, FrameType::kAction);
  }
  void Fault(BridgeFault kind, int64_t value, const char* text) {
    FaultFrame frame = {};
    frame.fault = kind;
    frame.value = value;
    std::strncpy(frame.detail, text, sizeof(frame.detail) - 1);
    Send(frame, FrameType::kFault);
  }
  // The next question; null when the simulator hung up.
  const PublishFrame* Hear() {
    const ssize_t size = recv(socket_.get(), question_.get(), sizeof(PublishFrame), 0);
    return size > 0 ? question_.get() : nullptr;
  }
  // Answers everything as a good policy would, until hung up.
  void PlayWell() {
    Hello();
    while (const PublishFrame* question = Hear()) Answer(*question);
  }
  void Answer(const PublishFrame& question) {
    if (question.expect == Expect::kReady) Ready(question.episode);
    if (question.expect == Expect::kAction) Act(question);
  }
  // Answers until step `step` of process episode `episode` is asked.
  bool PlayUntil(int64_t episode, int64_t step) {
    Hello();
    while (const PublishFrame* question = Hear()) {
      if (question->expect == Expect::kAction && question->episode == episode &&
          question->step == step) {
        return true;
      }
      Answer(*question);
    }
    return false;
  }
  int fd() const { return socket_.get(); }
  const PublishFrame& question() const { return *question_; }

 private:
  Fd socket_;
  std::unique_ptr<PublishFrame> question_ = std::make_unique<PublishFrame>();
};

using Script = std::function<void(Sandbox&)>;

// What came of a lease.
struct LeaseResult {
  absl::Status status;
  std::vector<EpisodeFacts> episodes;
  std::vector<FaultEvidence> seen;  // as the simulator reported faults
  int sandboxes = 0;
  int64_t progress = 0;
  bool done = false;
};

class LeasePlayerTest : public ::testing::Test {
 protected:
  LeasePlayerTest() {
    order_.track.kind = TrackKind::kManipulation;
    order_.track.profile = "paper";
    Budgets& budgets = order_.track.budgets;
    budgets = {};
    budgets.startup_s = 20;
    budgets.step_s = 1;
    budgets.overtime_s = 60;
    budgets.wall_factor = 10;
    budgets.lease_cpu_s = 1000;
    budgets.lease_wall_s = 1000;
    budgets.stray_messages = 50;
    budgets.wrong_answers = 15;
    budgets.restarts = 2;
    for (int64_t i = 0; i < 3; ++i) {
      order_.episodes.push_back({10 + i, static_cast<uint64_t>(100 + i), 7});
    }
  }

  // Plays the order; the n-th sandbox follows scripts[n], later ones the last.
  LeaseResult Play(std::vector<Script> scripts) {
    auto [here, there] = Pair();
    std::optional<LeasePlayer> player;
    player.emplace(order_, environment_, 1000, here.get(), &cpu_, SystemClock());
    LeaseResult result;
    std::thread runner([&, socket = there.get()] { PlayRunner(socket, scripts, result); });
    result.status = player->Play();
    // As at the process' end: every socket closes.
    player.reset();
    here.reset();
    runner.join();
    return result;
  }

  void PlayRunner(int socket, const std::vector<Script>& scripts, LeaseResult& result) {
    std::vector<std::thread> sandboxes;
    while (true) {
      absl::StatusOr<SimMessage> message = ReceiveSimMessage(socket, absl::Seconds(30));
      if (!message.ok()) break;
      const std::string type = message->json["type"];
      if (type == "need_policy") {
        if (refuse_.has_value()) {
          nlohmann::json refusal = FaultEvidenceToJson(*refuse_);
          refusal["type"] = "no_policy";
          (void)SendSimMessage(socket, refusal);
          ++result.sandboxes;
          continue;
        }
        auto [sim, sandbox] = Pair();
        const size_t n = std::min<size_t>(static_cast<size_t>(result.sandboxes++),
                                          scripts.size() - 1);
        sandboxes.emplace_back(
            [script = scripts[n], end = std::make_shared<Sandbox>(std::move(sandbox))] {
              script(*end);
            });
        (void)SendSimMessage(socket, {{"type", "policy"}}, sim.get());
      } else if (type == "policy_fault") {
        FaultEvidence evidence = *FaultEvidenceFromJson(message->json);
        result.seen.push_back(evidence);
        if (ruling_.has_value()) evidence.outcome = *ruling_;
        nlohmann::json ruling = FaultEvidenceToJson(evidence);
        ruling["type"] = "ruling";
        (void)SendSimMessage(socket, ruling);
      } else if (type == "episode") {
        result.episodes.push_back(*EpisodeFactsFromJson(message->json));
      } else if (type == "progress") {
        ++result.progress;
      } else if (type == "done") {
        result.done = true;
      }
    }
    for (std::thread& thread : sandboxes) thread.join();
  }

  LeaseOrder order_;
  CountingEnvironment environment_;
  CpuPage cpu_ = {0, 1};
  std::optional<FaultEvidence> refuse_;
  std::optional<Outcome> ruling_;
};

std::vector<Outcome> Outcomes(const LeaseResult& result) {
  std::vector<Outcome> outcomes;
  for (const EpisodeFacts& facts : result.episodes) {
    outcomes.push_back(facts.end == EpisodeEnd::kFault ? facts.fault.outcome : Outcome::kFailure);
  }
  return outcomes;
}

TEST_F(LeasePlayerTest, PlaysEveryEpisodeInOneSandbox) {
  const LeaseResult result = Play({[](Sandbox& sandbox) { sandbox.PlayWell(); }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_TRUE(result.done);
  EXPECT_EQ(result.sandboxes, 1);
  ASSERT_EQ(result.episodes.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const EpisodeFacts& facts = result.episodes[i];
    EXPECT_EQ(facts.index, static_cast<int64_t>(10 + i));
    EXPECT_EQ(facts.seed, 100 + i);
    EXPECT_EQ(facts.steps, 5);
    EXPECT_EQ(facts.end, EpisodeEnd::kTime);
    EXPECT_EQ(facts.digest.size(), 64u);
  }
  EXPECT_THAT(environment_.resets, ElementsAre(100, 101, 102));
  EXPECT_EQ(environment_.convention_used, ActionConvention::kDirect);
  EXPECT_NE(result.episodes[0].digest, result.episodes[1].digest);
}

TEST_F(LeasePlayerTest, DigestsAreOfTheStatesAlone) {
  const Script well = [](Sandbox& sandbox) { sandbox.PlayWell(); };
  const LeaseResult first = Play({well});
  const LeaseResult again = Play({well});
  EXPECT_EQ(first.episodes[2].digest, again.episodes[2].digest);
  const LeaseResult other = Play({[](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kReady) sandbox.Ready(question->episode);
      if (question->expect == Expect::kAction) sandbox.Act(*question, 2);
    }
  }});
  EXPECT_NE(first.episodes[2].digest, other.episodes[2].digest);
  // Two states of three doubles each, for one step after the other.
  Sha256 digest;
  for (int step = 1; step <= 5; ++step) {
    const std::array<double, 3> state = {100, 1.0 * step, 1.0 * step};
    digest.Update(std::as_bytes(std::span<const double>(state)));
  }
  EXPECT_EQ(first.episodes[0].digest, digest.FinishHex());
}

TEST_F(LeasePlayerTest, ThePolicyHearsWhatTheProtocolSays) {
  welcome_t welcome;
  std::vector<int64_t> episodes;
  std::vector<uint64_t> seeds;
  std::vector<double> first_values;
  order_.episodes[1].policy_seed = std::numeric_limits<uint64_t>::max();
  const LeaseResult result = Play({[&](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      const int size = static_cast<int>(question->payload_size);
      if (question->channel == Channel::kWelcome) {
        EXPECT_EQ(welcome.decode(question->payload, 0, size), size);
      } else if (question->channel == Channel::kEpisodeStart) {
        episode_start_t start;
        EXPECT_EQ(start.decode(question->payload, 0, size), size);
        episodes.push_back(start.episode);
        seeds.push_back(static_cast<uint64_t>(start.policy_seed));
      } else if (question->channel == Channel::kObservation) {
        observation_t observation;
        EXPECT_EQ(observation.decode(question->payload, 0, size), size);
        EXPECT_EQ(observation.size, 222);
        EXPECT_EQ(question->action_size, 80u);
        if (observation.step == 0) first_values.push_back(observation.values[0]);
      }
      sandbox.Answer(*question);
    }
  }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_EQ(welcome.accepted, 1);
  EXPECT_EQ(welcome.track, "manipulation");
  EXPECT_EQ(welcome.direct, 1);
  EXPECT_EQ(welcome.max_steps, 1000);
  EXPECT_EQ(welcome.observation_size, 222);
  EXPECT_EQ(welcome.action_size, 80);
  EXPECT_EQ(welcome.observation_low.size(), 222u);
  EXPECT_EQ(welcome.action_high.size(), 80u);
  // Its place in the process' run, never the evaluation's index or the seed.
  EXPECT_THAT(episodes, ElementsAre(0, 1, 2));
  EXPECT_THAT(seeds, ElementsAre(7u, std::numeric_limits<uint64_t>::max(), 7u));
  EXPECT_THAT(first_values, ElementsAre(100, 101, 102));
}

TEST_F(LeasePlayerTest, AFaultCostsOneEpisodeAndAFreshSandbox) {
  const LeaseResult result = Play({[](Sandbox& sandbox) {
                                  ASSERT_TRUE(sandbox.PlayUntil(0, 3));
                                  sandbox.Fault(BridgeFault::kPolicyExit, 256, "it exited");
                                  sandbox.Hear();
                                },
                                [](Sandbox& sandbox) { sandbox.PlayWell(); }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_EQ(result.sandboxes, 2);
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kCrash, Outcome::kFailure, Outcome::kFailure));
  EXPECT_EQ(result.episodes[0].steps, 3);  // what was played stays
  EXPECT_EQ(result.episodes[0].fault.step, 3);
  EXPECT_EQ(result.episodes[0].fault.value, 256);
  EXPECT_EQ(result.episodes[0].fault.detail, "it exited");
  EXPECT_EQ(std::get<ManipulationFacts>(result.episodes[0].track).effort_sum, 1.5);
}

TEST_F(LeasePlayerTest, AfterTheRestartsTheRestGetsTheLastFault) {
  order_.track.budgets.restarts = 1;
  order_.episodes.push_back({13, 103, 7});
  const LeaseResult result = Play({[](Sandbox& sandbox) {
    ASSERT_TRUE(sandbox.PlayUntil(0, 1));
    sandbox.Fault(BridgeFault::kProtocol, 16, "wrong step");
    sandbox.Hear();
  }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_EQ(result.sandboxes, 2);
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kProtocol, Outcome::kProtocol,
                                            Outcome::kProtocol, Outcome::kProtocol));
  EXPECT_EQ(result.episodes[1].steps, 1);
  EXPECT_EQ(result.episodes[2].steps, 0);
  EXPECT_EQ(result.episodes[3].fault.limit, "wrong_answers");
  EXPECT_EQ(result.episodes[3].fault.limit_value, 15);
  EXPECT_TRUE(result.done);
}

TEST_F(LeasePlayerTest, ASandboxThatEndsIsACrashAndTheRulingDecides) {
  ruling_ = Outcome::kMemoryLimit;
  order_.episodes.resize(1);
  const LeaseResult result =
      Play({[](Sandbox& sandbox) { ASSERT_TRUE(sandbox.PlayUntil(0, 2)); }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  ASSERT_EQ(result.seen.size(), 1u);
  EXPECT_EQ(result.seen[0].outcome, Outcome::kCrash);
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kMemoryLimit));
}

TEST_F(LeasePlayerTest, ARulingAgainstTheGraderEndsTheLease) {
  ruling_ = Outcome::kGraderError;
  const LeaseResult result =
      Play({[](Sandbox& sandbox) { ASSERT_TRUE(sandbox.PlayUntil(0, 2)); }});
  EXPECT_TRUE(absl::IsInternal(result.status));
  EXPECT_TRUE(result.episodes.empty());
  EXPECT_FALSE(result.done);
}

TEST_F(LeasePlayerTest, ACommandThatCanNotStartIsAFaultOfEachTry) {
  refuse_ = FaultEvidence{Outcome::kCrash, "", 0, 0, -1, "./policy is not executable"};
  const LeaseResult result = Play({[](Sandbox&) {}});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_EQ(result.sandboxes, 3);
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kCrash, Outcome::kCrash, Outcome::kCrash));
  EXPECT_EQ(result.episodes[2].fault.detail, "./policy is not executable");
}

TEST_F(LeasePlayerTest, AnotherProtocolVersionIsRefusedWithAReason) {
  order_.episodes.resize(1);
  std::string reason;
  const LeaseResult result = Play({[&](Sandbox& sandbox) {
    sandbox.Hello(2);
    const PublishFrame* question = sandbox.Hear();
    ASSERT_NE(question, nullptr);
    welcome_t welcome;
    welcome.decode(question->payload, 0, static_cast<int>(question->payload_size));
    EXPECT_EQ(welcome.accepted, 0);
    reason = welcome.reason;
  }});
  EXPECT_THAT(reason, HasSubstr("version 2"));
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kProtocol));
}

TEST_F(LeasePlayerTest, LegSetsOutOfRangeAreRefused) {
  order_.episodes.resize(1);
  const LeaseResult at_hello = Play({[](Sandbox& sandbox) {
    sandbox.Hello(1, 16);
    sandbox.Hear();
  }});
  EXPECT_THAT(Outcomes(at_hello), ElementsAre(Outcome::kProtocol));
  EXPECT_THAT(at_hello.episodes[0].fault.detail, HasSubstr("leg set 4"));
  const LeaseResult at_start = Play({[](Sandbox& sandbox) {
    sandbox.Hello();
    sandbox.Hear();
    sandbox.Hear();
    sandbox.Ready(0, 16);
    sandbox.Hear();
  }});
  EXPECT_THAT(Outcomes(at_start), ElementsAre(Outcome::kProtocol));
}

TEST_F(LeasePlayerTest, LegSetsOfTheHelloHoldForEveryEpisode) {
  order_.episodes.resize(2);
  const LeaseResult result = Play({[](Sandbox& sandbox) {
    sandbox.Hello(1, 1);
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kReady) {
        sandbox.Ready(question->episode, question->episode == 0 ? 2 : 0);
      } else {
        sandbox.Answer(*question);
      }
    }
  }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_THAT(environment_.sets_stored, ElementsAre(1u));  // of the second episode
}

TEST_F(LeasePlayerTest, AnswersOutOfTurnAreAFault) {
  order_.episodes.resize(1);
  const std::vector<Script> scripts = {
      [](Sandbox& sandbox) { sandbox.Ready(0); },
      [](Sandbox& sandbox) {
        ASSERT_TRUE(sandbox.PlayUntil(0, 2));
        PublishFrame wrong = sandbox.question();
        wrong.step = 1;
        sandbox.Act(wrong);
        sandbox.Hear();
      },
      [](Sandbox& sandbox) {
        ASSERT_TRUE(sandbox.PlayUntil(0, 2));
        (void)!send(sandbox.fd(), "nonsense", 8, MSG_NOSIGNAL);
        sandbox.Hear();
      }};
  for (const Script& script : scripts) {
    const LeaseResult result = Play({script});
    EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kProtocol));
  }
}

TEST_F(LeasePlayerTest, SilenceAtTheStartIsAnInitTimeout) {
  order_.episodes.resize(1);
  order_.track.budgets.startup_s = 1.2;
  const LeaseResult silent = Play({[](Sandbox& sandbox) { sandbox.Hear(); }});
  EXPECT_THAT(Outcomes(silent), ElementsAre(Outcome::kInitTimeout));
  EXPECT_EQ(silent.episodes[0].fault.limit, "startup_s");
  EXPECT_GT(silent.episodes[0].fault.value, 1.2);
  EXPECT_GE(silent.progress, 2);  // the runner hears from us while we wait
  // A hello alone is not enough.
  const LeaseResult half = Play({[](Sandbox& sandbox) {
    sandbox.Hello();
    while (sandbox.Hear() != nullptr) {
    }
  }});
  EXPECT_THAT(Outcomes(half), ElementsAre(Outcome::kInitTimeout));
}

TEST_F(LeasePlayerTest, CpuTimeBeyondTheBankIsAStepTimeout) {
  order_.episodes.resize(1);
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      // Each step takes 21 s of CPU time, 20 of them from the bank of 60.
      if (question->expect == Expect::kAction) cpu_.cpu_ns += 21'000'000'000u;
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kStepTimeout));
  EXPECT_EQ(result.episodes[0].steps, 3);
  EXPECT_EQ(result.episodes[0].fault.limit, "step_s");
  EXPECT_EQ(result.episodes[0].fault.value, 21);
}

TEST_F(LeasePlayerTest, ASleeperMeetsTheWallCap) {
  order_.episodes.resize(1);
  order_.track.budgets.step_s = 0.1;
  order_.track.budgets.overtime_s = 0.1;
  order_.track.budgets.wall_factor = 2;
  const LeaseResult result = Play({[](Sandbox& sandbox) {
    ASSERT_TRUE(sandbox.PlayUntil(0, 2));
    sandbox.Hear();
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kStepTimeout));
  EXPECT_EQ(result.episodes[0].fault.limit, "wall_factor");
  EXPECT_EQ(result.episodes[0].steps, 2);
}

TEST_F(LeasePlayerTest, TheBankIsFilledForEachEpisode) {
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction && question->step == 0) {
        cpu_.cpu_ns += 50'000'000'000u;
      }
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kFailure, Outcome::kFailure, Outcome::kFailure));
  EXPECT_EQ(result.episodes[1].policy_cpu_s, 50);
}

TEST_F(LeasePlayerTest, TheLeasesCapsEndTheWholeLease) {
  order_.track.budgets.lease_cpu_s = 30;
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction) cpu_.cpu_ns += 4'000'000'000u;
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kFailure, Outcome::kCpuLimit, Outcome::kCpuLimit));
  EXPECT_EQ(result.sandboxes, 1);
}

TEST_F(LeasePlayerTest, BadNumbersAreThePolicysButItsProcessGoesOn) {
  environment_.unstable_at = 3;
  const LeaseResult result = Play({[](Sandbox& sandbox) { sandbox.PlayWell(); }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kUnstable, Outcome::kUnstable, Outcome::kUnstable));
  EXPECT_EQ(result.sandboxes, 1);
  EXPECT_EQ(result.episodes[0].steps, 3);
  EXPECT_EQ(std::get<ManipulationFacts>(result.episodes[0].track).effort_sum, 0);
}

TEST_F(LeasePlayerTest, AnOverflowIsTheGraders) {
  environment_.overflow_at = 2;
  const LeaseResult result = Play({[](Sandbox& sandbox) { sandbox.PlayWell(); }});
  EXPECT_TRUE(absl::IsInternal(result.status)) << result.status;
  EXPECT_THAT(std::string(result.status.message()), HasSubstr("step 1 of episode 10"));
  EXPECT_TRUE(result.episodes.empty());
}

TEST_F(LeasePlayerTest, ARunnerThatIsGoneEndsTheLease) {
  auto [here, there] = Pair();
  there.reset();
  LeasePlayer player(order_, environment_, 1000, here.get(), &cpu_, SystemClock());
  EXPECT_TRUE(absl::IsUnavailable(player.Play()));
}

}  // namespace
}  // namespace myograde::sim
