// Which nodes may play.
#include "server/executor/slurm/node_health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/executor/slurm/node_state.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;

constexpr char kNodeBuild[] = R"({"models":{"a.mjb":"11"},"mujoco":"22","version":"1"})";

TEST(SlurmNodes, ANodeThatIsLikeTheDaemonPlays) {
  NodeHealth health;
  health.Proved("n1", "a processor");
  EXPECT_EQ(health.Views().front().state, "proved");
  EXPECT_EQ(health.Views().front().processor, "a processor");
  EXPECT_THAT(health.TakeDrained(), IsEmpty());
}

TEST(SlurmNodes, ADifferenceOfBuildsIsNamed) {
  EXPECT_EQ(BuildDifference(kNodeBuild, kNodeBuild), "");
  EXPECT_THAT(BuildDifference(kNodeBuild, R"({"models":{"a.mjb":"12"},"mujoco":"22","version":"1"})"),
              HasSubstr("models/a.mjb is 12, and the daemon's is 11"));
  EXPECT_NE(BuildDifference(kNodeBuild, R"({"mujoco":"22","version":"1"})"), "");
  EXPECT_NE(BuildDifference(kNodeBuild, "no json"), "");
}

TEST(SlurmNodes, AnUnfitNodeIsDrainedUntilSomebodyAdmitsIt) {
  NodeHealth health;
  health.Unfit("n1", "it plays episode 3 otherwise");
  health.Unfit("n1", "it plays episode 4 otherwise");
  EXPECT_THAT(health.Drained(), ElementsAre(Pair("n1", HasSubstr("episode 3"))));
  ASSERT_EQ(health.TakeDrained().size(), 1u);
  EXPECT_THAT(health.TakeDrained(), IsEmpty()) << "each once";
  health.Proved("n1", "a processor");
  EXPECT_TRUE(health.Drained().contains("n1"));
}

TEST(SlurmNodes, BadEndsInARowDrain) {
  NodeHealth health;
  for (int i = 0; i < NodeHealth::kMostBadEnds - 1; ++i) health.Ended("n1", true, "died");
  health.Ended("n1", false, "");
  for (int i = 0; i < NodeHealth::kMostBadEnds - 1; ++i) health.Ended("n1", true, "died");
  EXPECT_THAT(health.Drained(), IsEmpty());
  health.Ended("n1", true, "died again");
  EXPECT_THAT(health.Drained(), ElementsAre(Pair("n1", HasSubstr("the last one: died again"))));
  EXPECT_EQ(health.TakeDrained().size(), 1u);
  EXPECT_EQ(health.Views().front().faults, 5);
  EXPECT_EQ(health.Views().front().done, 1);
}

TEST(SlurmNodes, AnAdmittedNodeProvesItselfAgain) {
  NodeHealth health;
  health.Drain("n1", "its fan is loud");
  EXPECT_THAT(health.TakeDrained(), IsEmpty()) << "an organiser's is not its own";
  health.Admit("n1");
  EXPECT_EQ(health.Views().front().state, "new");
  EXPECT_THAT(health.ToProveAgain(), ElementsAre("n1"));
  health.Proved("n1", "a processor");
  EXPECT_THAT(health.ToProveAgain(), IsEmpty());
}

TEST(SlurmNodes, CountsWhatRuns) {
  NodeHealth health;
  health.Began("n1");
  health.Began("n1");
  health.Left("n1");
  health.Left("n2");
  EXPECT_EQ(health.Views().front().running, 1);
}

}  // namespace
}  // namespace myograde::server
