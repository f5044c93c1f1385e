// The engine's core in a simulated world: single cases, and thousands of random histories with
// crashes, delays, duplicated and lost messages, full disks and jumping clocks.
#include <unistd.h>

#include <filesystem>
#include <random>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "history_world.h"

namespace myograde::server {
namespace {

std::string Folder() {
  static int number = 0;
  // In memory if possible: thousands of stores are created and removed.
  const bool memory = access("/dev/shm", W_OK) == 0;
  const std::string root = memory ? "/dev/shm" : std::filesystem::temp_directory_path().string();
  return absl::StrCat(root, "/myograde-history-", getpid(), "-", ++number);
}

class EngineCoreTest : public ::testing::Test {
 protected:
  static void RunFor(World& world, absl::Duration time) {
    const absl::Duration until = world.clock.Monotonic() + time;
    while (world.clock.Monotonic() < until) world.RunOnce();
  }
  static EvaluationState StateOf(World& world, int64_t evaluation) {
    EvaluationState state = EvaluationState::kQueued;
    EXPECT_TRUE(world.readers->Read([&](const Transaction& reader) {
      state = reader.evaluations.Find(evaluation)->state;
      return absl::OkStatus();
    }).ok());
    return state;
  }
};

TEST_F(EngineCoreTest, PlaysWhatItIsGiven) {
  World world(Folder(), {}, 2);
  const int64_t id = world.Submit("a", 6);
  EXPECT_EQ(StateOf(world, id), EvaluationState::kRunning);
  RunFor(world, absl::Minutes(2));
  EXPECT_EQ(StateOf(world, id), EvaluationState::kDone);
  EXPECT_TRUE(world.core->idle());
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

TEST_F(EngineCoreTest, DeadlinesDoNotHearOfTheCalendar) {
  World world(Folder(), {}, 1);
  const int64_t id = world.Submit("a", 6);
  RunFor(world, absl::Seconds(3));
  for (const absl::Duration jump : {absl::Hours(1000), -absl::Hours(5000)}) {
    world.JumpClock(jump);
    RunFor(world, absl::Seconds(3));
    EXPECT_EQ(world.core->Running().size(), 1u) << "the lease went on";
  }
  RunFor(world, absl::Minutes(5));
  EXPECT_EQ(StateOf(world, id), EvaluationState::kDone);
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    const std::vector<BlockRow> blocks = *reader.blocks.Of(id);
    for (const BlockRow& block : blocks) EXPECT_EQ(block.attempt, 1);
    return absl::OkStatus();
  }).ok());
}

TEST_F(EngineCoreTest, NoRunnerIsSilentWhileTheDaemonStandsStill) {
  World world(Folder(), {}, 1);
  const int64_t id = world.Submit("a", 6);
  while (StateOf(world, id) != EvaluationState::kDone) {
    RunFor(world, absl::Seconds(2));
    // The daemon is stopped between its look at the runner and its look at the deadlines.
    world.next_look_takes = absl::Seconds(31);
  }
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    const std::vector<BlockRow> blocks = *reader.blocks.Of(id);
    for (const BlockRow& block : blocks) EXPECT_EQ(block.faults, 0);
    return absl::OkStatus();
  }).ok());
}

TEST_F(EngineCoreTest, ACancelCountsAtOnceAndIsAnsweredWhenTheRunnerIsDead) {
  World world(Folder(), {}, 1);
  const int64_t id = world.Submit("a", 6);
  RunFor(world, absl::Seconds(3));
  std::optional<CancelReport> report;
  const CancelOrder order = {.submission = 1, .reruns = true, .why = "why", .who = "who"};
  world.core->Cancel(order, [&](absl::StatusOr<CancelReport> answer) {
    ASSERT_TRUE(answer.ok()) << answer.status();
    report = *answer;
  });
  EXPECT_EQ(StateOf(world, id), EvaluationState::kCancelled) << "before anything is dead";
  EXPECT_EQ(world.core->Health().ending, 1);
  RunFor(world, absl::Seconds(1));
  ASSERT_TRUE(report.has_value());
  EXPECT_EQ(report->killed, 1);
  EXPECT_EQ(report->still_ending, 0);
  EXPECT_LE(report->took, absl::Seconds(1));
  EXPECT_EQ(world.core->Health().ending, 0);
  std::optional<absl::Status> again;
  world.core->Cancel(order, [&](absl::StatusOr<CancelReport> answer) { again = answer.status(); });
  ASSERT_TRUE(again.has_value());
  EXPECT_TRUE(absl::IsFailedPrecondition(*again));
}

TEST_F(EngineCoreTest, WhatNeedsAMissingRuntimeIsNotTriedAgainAndTheHostIsWell) {
  World world(Folder(), {}, 2);
  world.needs_runtimes = {"gone"};
  const int64_t id = world.Submit("a", 6);
  RunFor(world, absl::Seconds(1));
  EXPECT_EQ(StateOf(world, id), EvaluationState::kGraderError);
  EXPECT_EQ(world.core->Health().host, HostHealth::State::kWell);
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.evaluations.Find(id)->reason,
              "a block of episodes can't be played: there is no runtime \"gone\"");
    int64_t attempts = 0;
    const std::vector<BlockRow> blocks = *reader.blocks.Of(id);
    for (const BlockRow& block : blocks) attempts += block.attempt;
    EXPECT_LE(attempts, 2) << "at most one for each slot";
    return absl::OkStatus();
  }).ok());
}

TEST_F(EngineCoreTest, WhatAnExpiredLeaseSaysLaterIsRefused) {
  World world(Folder(), {}, 2);
  world.next_is_late = absl::Seconds(45);
  world.next_dies_late = absl::Minutes(2);
  const int64_t id = world.Submit("a", 2);
  RunFor(world, absl::Seconds(31));
  EXPECT_EQ(world.core->Health().ending, 1) << "its process holds on to its slot";
  // The new runner reports both episodes first, then the old one.
  RunFor(world, absl::Seconds(19));
  EXPECT_EQ(StateOf(world, id), EvaluationState::kDone);
  EXPECT_EQ(world.core->Health().ending, 1);
  RunFor(world, absl::Seconds(20));
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    const BlockRow block = reader.blocks.Of(id)->front();
    EXPECT_EQ(block.attempt, 2);
    EXPECT_EQ(block.faults, 1);
    const std::vector<EpisodeRow> rows = *reader.episodes.Of(id);
    for (const EpisodeRow& row : rows) EXPECT_EQ(row.attempt, 2);
    return absl::OkStatus();
  }).ok());
  EXPECT_TRUE(world.core->idle());
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

TEST_F(EngineCoreTest, ASlotStaysClosedAsLongAsAProcessOfItsSandboxesLives) {
  World world(Folder(), {}, 1);
  const int64_t first = world.Submit("a", 2);
  RunFor(world, absl::Seconds(1));
  world.left[0] = "71 (reader, state D)";
  const int64_t second = world.Submit("b", 2);
  RunFor(world, absl::Minutes(2));
  EXPECT_EQ(StateOf(world, first), EvaluationState::kDone) << "what it recorded counts";
  EXPECT_EQ(StateOf(world, second), EvaluationState::kQueued);
  ASSERT_EQ(world.core->Health().closed_slots.count(0), 1u);
  EXPECT_EQ(world.core->Health().closed_slots[0], "71 (reader, state D)");
  EXPECT_NE(world.core->EstimateOutlook(second).waiting.find("slot 0 is closed until 71"),
            std::string::npos);
  // The next daemon sees it too.
  world.Cut();
  world.Boot();
  RunFor(world, absl::Minutes(2));
  EXPECT_EQ(StateOf(world, second), EvaluationState::kQueued);
  world.left.clear();
  RunFor(world, absl::Minutes(2));
  EXPECT_EQ(StateOf(world, second), EvaluationState::kDone);
  EXPECT_TRUE(world.core->Health().closed_slots.empty());
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

TEST_F(EngineCoreTest, AClosedSlotKeepsNoOtherFromPlaying) {
  World world(Folder(), {}, 2);
  world.left[1] = "72 (reader, state D)";
  world.Boot();
  const int64_t id = world.Submit("a", 4);
  const absl::Duration until = world.clock.Monotonic() + absl::Minutes(2);
  while (world.clock.Monotonic() < until) {
    world.RunOnce();
    ASSERT_FALSE(world.slots_in_use.contains(1));
  }
  EXPECT_EQ(StateOf(world, id), EvaluationState::kDone);
  EXPECT_EQ(world.core->Health().closed_slots.size(), 1u);
  EXPECT_EQ(world.core->Health().closed_slots[1], "72 (reader, state D)");
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

TEST_F(EngineCoreTest, ARunnerThatStaysAfterItsLastWordKeepsItsSlotAndNothingElse) {
  World world(Folder(), {}, 1);
  world.next_lingers = absl::Minutes(5);
  const int64_t first = world.Submit("a", 2);
  const int64_t second = world.Submit("b", 2);
  RunFor(world, absl::Minutes(2));
  EXPECT_EQ(StateOf(world, first), EvaluationState::kDone);
  EXPECT_EQ(StateOf(world, second), EvaluationState::kQueued);
  EXPECT_EQ(world.core->Health().ending, 1);
  RunFor(world, absl::Minutes(6));
  EXPECT_EQ(StateOf(world, second), EvaluationState::kDone);
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.blocks.Of(first).value().front().faults, 0);
    return absl::OkStatus();
  }).ok());
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

TEST_F(EngineCoreTest, AStopPutsLeasesBackAndAnswersWhoeverWaits) {
  World world(Folder(), {}, 2);
  const int64_t id = world.Submit("a", 4);
  RunFor(world, absl::Seconds(3));
  world.core->BeginShutdown();
  std::optional<absl::Status> refused;
  world.core->Ask({[](Transaction&) { return absl::OkStatus(); }, nullptr,
                   [&](absl::Status status) { refused = status; }});
  RunFor(world, absl::Seconds(1));
  EXPECT_TRUE(world.core->idle());
  ASSERT_TRUE(refused.has_value());
  EXPECT_TRUE(absl::IsCancelled(*refused));
  EXPECT_TRUE(world.core->FinishShutdown().ok());
  world.Boot();
  RunFor(world, absl::Minutes(5));
  EXPECT_EQ(StateOf(world, id), EvaluationState::kDone);
  world.CheckStore();
  EXPECT_EQ(world.broken, "");
}

RC_GTEST_FIXTURE_PROP(EngineCoreTest, WhateverHappensEveryEpisodeCountsOnceAndAllEnds, ()) {
  // Uniform bytes, whatever RapidCheck's size is; a failing tape shrinks from its end.
  std::mt19937_64 random(*rc::gen::resize(100, rc::gen::arbitrary<uint64_t>()));
  std::vector<uint8_t> bytes(*rc::gen::resize(100, rc::gen::inRange<size_t>(0, 4000)));
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
  const bool remote = *rc::gen::arbitrary<bool>();
  World world(Folder(), bytes, *rc::gen::resize(100, rc::gen::inRange(1, 4)), "", remote);
  // New calls keep coming while things go wrong.
  for (int i = 0; i < 400 && !world.tape.over() && world.broken.empty(); ++i) {
    if (world.tape.Happens(24)) {
      world.Submit(std::string(1, static_cast<char>('a' + world.tape.Below(3))),
                   1 + world.tape.Below(7));
    }
    if (world.tape.Happens(4) && !world.evaluations.empty()) {
      world.Cancel(1 + world.tape.Below(static_cast<int>(world.evaluations.size())));
    }
    if (world.tape.Happens(8)) world.JumpClock(absl::Hours(world.tape.Below(200) - 100));
    world.RunOnce();
  }
  // From here on nothing fails, and everything must finish.
  world.tape.Stop();
  for (int i = 0; i < 1000 && world.broken.empty() && !world.AllEnded(); ++i) {
    for (int turns = 0; turns < 20; ++turns) world.RunOnce();
  }
  RunFor(world, absl::Seconds(1));  // a cancel may still wait for a runner's death
  world.CheckStore();
  RC_ASSERT(world.broken == "");
  if (!world.AllEnded()) RC_FAIL(world.WhatIsOpen());
  RC_ASSERT(world.cancels_open == 0);
  RC_CLASSIFY(remote, "on a cluster");
  RC_CLASSIFY(world.power_cuts > 0, "with power cuts");
  RC_CLASSIFY(world.evaluations.size() > 3, "with more than three evaluations");
}

}  // namespace
}  // namespace myograde::server
