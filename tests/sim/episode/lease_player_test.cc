// What a lease plays, says and records.
#include "tests/sim/episode/lease_world.h"

namespace myograde::sim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

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

// The welcome, and the values of the first observation, as a policy sees them.
struct Seen {
  welcome_t welcome;
  std::vector<double> values;
};

Seen LookAt(Sandbox& sandbox, Seen seen = {}) {
  sandbox.Hello();
  while (const PublishFrame* question = sandbox.Hear()) {
    const int size = static_cast<int>(question->payload_size);
    observation_t observation;
    if (question->channel == Channel::kWelcome) {
      EXPECT_EQ(seen.welcome.decode(question->payload, 0, size), size);
    } else if (question->channel == Channel::kObservation && seen.values.empty()) {
      EXPECT_EQ(observation.decode(question->payload, 0, size), size);
      seen.values = observation.values;
    }
    sandbox.Answer(*question);
  }
  return seen;
}

TEST_F(LeasePlayerTest, ExtraObservationsFollowTheGradedOnesAndChangeNoDigest) {
  Seen with, without;
  order_.episodes.resize(1);
  const LeaseResult plain = Play({[&](Sandbox& sandbox) { without = LookAt(sandbox); }});
  order_.extra_observations = true;
  const LeaseResult extra = Play({[&](Sandbox& sandbox) { with = LookAt(sandbox); }});
  ASSERT_TRUE(plain.done && extra.done);
  EXPECT_EQ(plain.episodes[0].digest, extra.episodes[0].digest);

  const VectorLayout& graded = ObservationOf(ManipulationTrack());
  const VectorLayout& added = ExtraOf(ManipulationTrack());
  const auto all = static_cast<size_t>(graded.size() + added.size());
  EXPECT_EQ(all, 253u);
  EXPECT_EQ(without.values.size(), 222u);
  EXPECT_EQ(with.welcome.observation_size, 253);
  EXPECT_EQ(with.welcome.observation_low.size(), all);
  EXPECT_EQ(with.welcome.observation_high.size(), all);
  ASSERT_EQ(with.values.size(), all);
  EXPECT_TRUE(std::equal(without.values.begin(), without.values.end(), with.values.begin()));
  for (size_t i = without.values.size(); i < all; ++i) EXPECT_EQ(with.values[i], 1000) << i;
  // The parts have no gap, and begin with those of the graded vector.
  int next = 0;
  for (const part_t& part : with.welcome.observation_parts) {
    EXPECT_EQ(part.offset, next) << part.name;
    next += part.size;
  }
  EXPECT_EQ(next, 253);
  const size_t parts = without.welcome.observation_parts.size();
  EXPECT_EQ(with.welcome.observation_parts.size(), parts + added.parts().size());
  EXPECT_EQ(with.welcome.observation_parts[parts].name, "max_force");
  EXPECT_EQ(with.welcome.observation_parts[parts].offset, 222);
}

TEST_F(LeasePlayerTest, AnEpisodeThatIsGivenUpEndsAsItStandsAndTheSameProcessPlaysOn) {
  std::vector<std::pair<int64_t, int64_t>> ends;  // as the policy hears them
  const LeaseResult result = Play({[&](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->channel == Channel::kEpisodeEnd) {
        episode_end_t end;
        end.decode(question->payload, 0, static_cast<int>(question->payload_size));
        ends.emplace_back(end.episode, end.steps);
      }
      const bool enough = question->expect == Expect::kAction &&
                          question->step == (question->episode == 0 ? 2 : 0);
      if (enough && question->episode < 2) {
        sandbox.GiveUp(*question);
      } else {
        sandbox.Answer(*question);
      }
    }
  }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_TRUE(result.done);
  EXPECT_EQ(result.sandboxes, 1);
  EXPECT_TRUE(result.seen.empty());
  ASSERT_EQ(result.episodes.size(), 3u);
  EXPECT_EQ(result.episodes[0].end, EpisodeEnd::kGivenUp);
  EXPECT_EQ(result.episodes[0].steps, 2);
  EXPECT_EQ(std::get<ManipulationFacts>(result.episodes[0].track).effort_sum, 1.0);
  EXPECT_EQ(result.episodes[1].end, EpisodeEnd::kGivenUp);
  EXPECT_EQ(result.episodes[1].steps, 0);
  EXPECT_EQ(result.episodes[2].end, EpisodeEnd::kTime);
  EXPECT_EQ(result.episodes[2].steps, 5);
  EXPECT_THAT(ends, ElementsAre(std::pair(0, 2), std::pair(1, 0), std::pair(2, 5)));
  EXPECT_THAT(environment_.resets, ElementsAre(100, 101, 102));
}

TEST_F(LeasePlayerTest, GivingUpAnotherStepIsAFault) {
  order_.episodes.resize(1);
  const LeaseResult result = Play({[](Sandbox& sandbox) {
    ASSERT_TRUE(sandbox.PlayUntil(0, 2));
    PublishFrame wrong = sandbox.question();
    wrong.step = 3;
    sandbox.GiveUp(wrong);
    sandbox.Hear();
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kProtocol));
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

TEST_F(LeasePlayerTest, WhereNoPolicyIsStartedAnyMoreTheRestOfTheLeaseGetsThatFault) {
  refuse_ = FaultEvidence{Outcome::kCrash, "", 0, 0, 7, "what it left behind stays", ""};
  const LeaseResult result = Play({[](Sandbox&) {}});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_EQ(result.sandboxes, 1);
  EXPECT_TRUE(result.seen.empty());  // it is a ruling already
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kCrash, Outcome::kCrash, Outcome::kCrash));
  EXPECT_EQ(result.episodes[2].fault.detail, "what it left behind stays");
  EXPECT_EQ(result.episodes[2].fault.step, -1);
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

}  // namespace
}  // namespace myograde::sim
