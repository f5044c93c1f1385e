// Which nodes may play.
#include "server/executor/slurm/node_health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kNodeBuild[] = R"({"models":{"a.mjb":"11"},"mujoco":"22","version":"1"})";

NodeProof ProofOf(const std::string& node, const std::string& grader = kNodeBuild) {
  NodeProof proof;
  proof.node = node;
  proof.processor = "a processor";
  proof.grader = grader;
  return proof;
}

TEST(SlurmNodes, ANodeThatIsLikeTheDaemonPlays) {
  NodeHealth health;
  EXPECT_EQ(health.Prove(ProofOf("n1"), kNodeBuild), "");
  EXPECT_EQ(health.Views().front().state, "proved");
  EXPECT_EQ(health.Views().front().processor, "a processor");
  EXPECT_THAT(health.TakeDrained(), IsEmpty());
}

TEST(SlurmNodes, ANodeWithAnotherBuildIsDrainedAndTheDifferenceNamed) {
  NodeHealth health;
  const std::string why =
      health.Prove(ProofOf("n1", R"({"models":{"a.mjb":"12"},"mujoco":"22","version":"1"})"), kNodeBuild);
  EXPECT_THAT(why, HasSubstr("its models/a.mjb is 12, and the daemon's is 11"));
  EXPECT_THAT(health.Drained(), ElementsAre("n1"));
  ASSERT_EQ(health.TakeDrained().size(), 1u);
  EXPECT_THAT(health.TakeDrained(), IsEmpty()) << "each once";
  EXPECT_NE(health.Prove(ProofOf("n1"), kNodeBuild), "") << "until somebody admits it";
  EXPECT_NE(health.Prove(ProofOf("n2", R"({"mujoco":"22","version":"1"})"), kNodeBuild), "");
  EXPECT_NE(health.Prove(ProofOf("n3", "no json"), kNodeBuild), "");
}

TEST(SlurmNodes, ANodeThatComputesDifferentlyOrLacksSomethingIsDrained) {
  NodeHealth health;
  NodeProof proof = ProofOf("n1");
  proof.reference = "episode 3 differs";
  EXPECT_THAT(health.Prove(proof, kNodeBuild), HasSubstr("episode 3 differs"));
  proof = ProofOf("n2");
  proof.doctor = {"no user namespaces"};
  EXPECT_THAT(health.Prove(proof, kNodeBuild), HasSubstr("no user namespaces"));
}

TEST(SlurmNodes, BadEndsInARowDrain) {
  NodeHealth health;
  for (int i = 0; i < NodeHealth::kMostBadEnds - 1; ++i) health.Ended("n1", true, "died");
  health.Ended("n1", false, "");
  for (int i = 0; i < NodeHealth::kMostBadEnds - 1; ++i) health.Ended("n1", true, "died");
  EXPECT_FALSE(health.drained("n1"));
  health.Ended("n1", true, "died again");
  EXPECT_TRUE(health.drained("n1"));
  EXPECT_THAT(health.WhyDrained("n1"), HasSubstr("the last one: died again"));
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
  EXPECT_EQ(health.Prove(ProofOf("n1"), kNodeBuild), "");
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
