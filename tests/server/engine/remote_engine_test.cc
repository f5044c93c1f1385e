// The engine on a cluster: leases wait for a processor there, nodes are lost, drained and admitted.
#include <unistd.h>

#include <filesystem>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "history_world.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

std::string RemoteFolder() {
  static int number = 0;
  return absl::StrCat(std::filesystem::temp_directory_path().string(), "/myograde-remote-",
                      getpid(), "-", ++number);
}

class RemoteEngineTest : public ::testing::Test {
 protected:
  void RunFor(absl::Duration time) {
    const absl::Duration until = world.clock.Monotonic() + time;
    while (world.clock.Monotonic() < until) world.RunOnce();
  }
  BlockRow OnlyBlock(int64_t evaluation) {
    BlockRow row;
    EXPECT_TRUE(world.readers->Read([&](const Transaction& reader) {
      row = reader.blocks.Of(evaluation)->front();
      return absl::OkStatus();
    }).ok());
    return row;
  }
  std::vector<AttemptRow> ListAttempts(int64_t evaluation) {
    std::vector<AttemptRow> rows;
    EXPECT_TRUE(world.readers->Read([&](const Transaction& reader) {
      rows = *reader.blocks.ListAttempts(evaluation);
      return absl::OkStatus();
    }).ok());
    return rows;
  }
  void ExpectSound() {
    world.CheckStore();
    EXPECT_EQ(world.broken, "");
  }

  World world{RemoteFolder(), {}, 1, "", /*is_remote=*/true};
};

TEST_F(RemoteEngineTest, ALeaseThatWaitsForAProcessorIsNeitherSilentNorLate) {
  world.next_begins_late = absl::Hours(5);
  const int64_t id = world.Submit("a", 2);
  RunFor(absl::Hours(4));
  ASSERT_EQ(world.core->Running().size(), 1u);
  const LiveLease waits = world.core->Running().begin()->second;
  EXPECT_FALSE(waits.begun);
  EXPECT_EQ(waits.site.node, "node0");
  EXPECT_EQ(waits.site.job, "7_0");
  RunFor(absl::Hours(1) + absl::Seconds(2));
  const LiveLease runs = world.core->Running().begin()->second;
  EXPECT_TRUE(runs.begun);
  EXPECT_LT(runs.running, absl::Seconds(10)) << "its time began with it";
  RunFor(absl::Minutes(2));
  EXPECT_TRUE(world.AllEnded());
  EXPECT_EQ(OnlyBlock(id).attempt, 1);
  ExpectSound();
}

TEST_F(RemoteEngineTest, ALostLeaseIsPlayedAgainWithoutAFault) {
  world.next_is_lost_after = absl::Seconds(6);
  const int64_t id = world.Submit("a", 2);
  RunFor(absl::Minutes(2));
  EXPECT_TRUE(world.AllEnded());
  const BlockRow block = OnlyBlock(id);
  EXPECT_EQ(block.attempt, 2);
  EXPECT_EQ(block.faults, 0);
  const std::vector<AttemptRow> runs = ListAttempts(id);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].how, RunEnd::kReturned);
  EXPECT_EQ(runs[1].how, RunEnd::kDone);
  EXPECT_EQ(runs[1].node, "node0");
  EXPECT_EQ(runs[1].job, "7_0");
  EXPECT_EQ(runs[1].cpu_s, 1.5);
  EXPECT_EQ(runs[1].energy_j, 40);
  EXPECT_EQ(world.ends, (std::vector<std::pair<std::string, bool>>{{"node0", false}}));
  ExpectSound();
}

TEST_F(RemoteEngineTest, LeasesThatAreLostOneAfterTheOtherAreTold) {
  world.next_is_lost_after = absl::Seconds(6);
  const int64_t id = world.Submit("a", 2);
  for (int i = 0; i < 7200 && world.core->Health().losses.empty(); ++i) {
    world.next_is_lost_after = absl::Seconds(6);
    RunFor(absl::Seconds(1));
  }
  world.next_is_lost_after = absl::InfiniteDuration();
  EXPECT_EQ(OnlyBlock(id).attempt, 10);
  EXPECT_THAT(world.core->Health().losses, HasSubstr("the last 10 leases were lost"));
  RunFor(absl::Hours(2));
  EXPECT_TRUE(world.AllEnded());
  EXPECT_EQ(world.core->Health().losses, "");
  ExpectSound();
}

TEST_F(RemoteEngineTest, ASilentOneIsReturnedAndSaysNothingMore) {
  world.next_is_late = absl::Seconds(45);
  world.next_dies_late = absl::Minutes(10);
  const int64_t id = world.Submit("a", 2);
  RunFor(absl::Minutes(15));
  EXPECT_TRUE(world.AllEnded());
  const BlockRow block = OnlyBlock(id);
  EXPECT_EQ(block.attempt, 2);
  EXPECT_EQ(block.faults, 0);
  ExpectSound();
}

TEST_F(RemoteEngineTest, NothingStartsWhileTheClusterTakesNothing) {
  world.cannot_start = "the shared folder is full";
  const int64_t id = world.Submit("a", 2);
  RunFor(absl::Minutes(5));
  EXPECT_TRUE(world.core->Running().empty());
  EXPECT_EQ(world.core->Health().executor_trouble, "the shared folder is full");
  EXPECT_THAT(world.core->EstimateOutlook(id).waiting,
              HasSubstr("nothing starts: the shared folder is full"));
  world.cannot_start = "";
  RunFor(absl::Minutes(2));
  EXPECT_TRUE(world.AllEnded());
  ExpectSound();
}

TEST_F(RemoteEngineTest, ADrainedNodeIsRemembered) {
  world.drained = {{"node3", "its simulator is another one"}};
  world.RunOnce();
  world.RunOnce();
  EXPECT_TRUE(world.drained.empty());
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    const std::vector<DrainedNodeRow> drained = reader.blocks.DrainedNodes().rows;
    EXPECT_EQ(drained.size(), 1u);
    if (drained.empty()) return absl::OkStatus();
    EXPECT_EQ(drained.front().node, "node3");
    EXPECT_EQ(drained.front().why, "its simulator is another one");
    return absl::OkStatus();
  }).ok());
}

TEST_F(RemoteEngineTest, ACancelAccountsForWhatRan) {
  const int64_t id = world.Submit("a", 2);
  RunFor(absl::Seconds(3));
  world.Cancel(1);
  RunFor(absl::Seconds(3));
  const std::vector<AttemptRow> runs = ListAttempts(id);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].how, RunEnd::kCancelled);
  EXPECT_EQ(world.cancels_open, 0);
}

}  // namespace
}  // namespace myograde::server
