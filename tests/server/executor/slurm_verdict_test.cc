// What is whose fault, and that nothing is waited for without an end.
#include "server/executor/slurm/attempt_verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/executor/spool/forms.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using Kind = AttemptVerdict::Kind;

constexpr absl::Duration kNever = absl::InfiniteDuration();

class SlurmVerdict : public ::testing::Test {
 protected:
  SlurmVerdict() {
    view_.started = At(0);
    view_.job.seen = -kNever;
    view_.job.over_since = kNever;
  }
  static absl::Duration At(double seconds) { return absl::Seconds(1000 + seconds); }
  AttemptVerdict Judge(double seconds) const { return JudgeAttempt(view_, limits_, At(seconds)); }
  void Submit() { view_.job.id = "12_0"; }
  void Run(double seconds) {
    Submit();
    view_.job.state = JobState::kRunning;
    view_.job.node = "n1";
    view_.job.seen = view_.running = At(seconds);
  }
  void Claim(double seconds) {
    view_.claimed = At(seconds);
    view_.claim_node = "n1";
  }
  void Over(JobState state, double seconds) {
    view_.job.state = state;
    view_.job.over_since = view_.job.seen = At(seconds);
    view_.looked = At(seconds + 20);
  }

  AttemptView view_;
  const AttemptLimits limits_{.queue_wait = absl::Seconds(600), .claim = absl::Seconds(60)};
};

TEST_F(SlurmVerdict, AJobThatFailedSaysWhy) {
  Submit();
  const std::pair<int, const char*> cases[] = {
      {9, "signal 9"},           {137 << 8, "signal 9"},      {127 << 8, "bin_dir"},
      {kNodeClock << 8, "clock"}, {kNodeUnreachable << 8, "can't reach"},
      {kNodeCaFile << 8, "ca_file"}, {kNodeUntrusted << 8, "does not trust the TLS certificate"},
      {4 << 8, "exit status was 4"}};
  for (const auto& [status, words] : cases) {
    view_.job.wait_status = status;
    Over(JobState::kFailed, 12);
    EXPECT_THAT(Judge(40).why, HasSubstr(words)) << status;
  }
}

TEST_F(SlurmVerdict, WhatGoesOnGoesOn) {
  EXPECT_EQ(Judge(100).kind, Kind::kGoesOn);
  Submit();
  EXPECT_EQ(Judge(500).kind, Kind::kGoesOn);
  Run(510);
  EXPECT_EQ(Judge(560).kind, Kind::kGoesOn);
  Claim(560);
  EXPECT_EQ(Judge(600).kind, Kind::kGoesOn);
  view_.heard = At(601);
  EXPECT_EQ(Judge(1e6).kind, Kind::kGoesOn) << "its time is the engine's business";
}

TEST_F(SlurmVerdict, AWaitInTheQueueHasAnEnd) {
  Submit();
  view_.job.reason = "Resources";
  const AttemptVerdict verdict = Judge(600);
  EXPECT_EQ(verdict.kind, Kind::kLost);
  EXPECT_EQ(verdict.why, "job 12_0 had not begun after 600 s (Resources)");
  EXPECT_EQ(verdict.blame_node, "");
}

TEST_F(SlurmVerdict, ASubmissionThatFailsHasAnEnd) {
  view_.submit_trouble = At(0);
  view_.submit_why = "Invalid partition";
  EXPECT_EQ(Judge(179).kind, Kind::kGoesOn);
  EXPECT_THAT(Judge(180).why, HasSubstr("no job could be submitted: Invalid partition"));
}

TEST_F(SlurmVerdict, AJobThatDoesNotTakeItsLeaseIsItsNodesDoing) {
  Run(10);
  EXPECT_EQ(Judge(69).kind, Kind::kGoesOn);
  const AttemptVerdict verdict = Judge(70);
  EXPECT_EQ(verdict.kind, Kind::kLost);
  EXPECT_EQ(verdict.blame_node, "n1");
  EXPECT_THAT(verdict.why, HasSubstr("has not taken its lease"));
}

TEST_F(SlurmVerdict, ANodeThatPreparesForEverIsGivenUp) {
  Run(10);
  Claim(11);
  EXPECT_EQ(Judge(900).kind, Kind::kGoesOn);
  EXPECT_EQ(Judge(911).kind, Kind::kLost);
  EXPECT_EQ(Judge(911).blame_node, "n1");
}

TEST_F(SlurmVerdict, ARequeuedJobIsNobodysFaultButAnOldAnswerIsNoRequeue) {
  Run(10);
  Claim(20);
  view_.job.state = JobState::kWaiting;
  view_.job.seen = At(15);
  EXPECT_EQ(Judge(21).kind, Kind::kGoesOn) << "it was asked before the claim";
  view_.job.seen = At(22);
  const AttemptVerdict verdict = Judge(23);
  EXPECT_EQ(verdict.kind, Kind::kLost);
  EXPECT_THAT(verdict.why, HasSubstr("was put back"));
}

TEST_F(SlurmVerdict, TheNodesLastWordIsWaitedFor) {
  Run(10);
  Claim(20);
  Over(JobState::kDone, 100);
  view_.looked = At(110);
  EXPECT_EQ(Judge(300).kind, Kind::kGoesOn) << "the folder could not be read since";
  EXPECT_EQ(Judge(700).kind, Kind::kLost) << "but not for ever";
  view_.looked = At(115);
  EXPECT_EQ(Judge(116).kind, Kind::kLost);
}

TEST_F(SlurmVerdict, OnlyALimitThatTheLeaseReachedIsAFault) {
  for (const JobState state : {JobState::kDone, JobState::kFailed, JobState::kNodeLost,
                               JobState::kPreempted, JobState::kCancelled}) {
    Run(10);
    Claim(20);
    Over(state, 100);
    EXPECT_EQ(Judge(120).kind, Kind::kLost);
    EXPECT_EQ(Judge(120).blame_node, "");
  }
  for (const JobState state : {JobState::kTimeLimit, JobState::kMemory}) {
    Over(state, 100);
    EXPECT_EQ(Judge(120).kind, Kind::kFault);
  }
  Over(JobState::kTimeLimit, 100);
  EXPECT_EQ(Judge(120).why, "job 12_0 on n1 reached its time limit before its lease had ended");
}

TEST_F(SlurmVerdict, WhyANodeGaveALeaseBackIsAskedOfTheCluster) {
  Run(10);
  Claim(20);
  view_.given_back = At(100);
  view_.given_back_why = "told to end";
  EXPECT_EQ(Judge(105).kind, Kind::kGoesOn);
  EXPECT_EQ(Judge(110).why, "the node n1 gave it back: told to end") << "the cluster may be down";
  EXPECT_EQ(Judge(110).blame_node, "");
  Over(JobState::kTimeLimit, 103);
  EXPECT_EQ(Judge(104).kind, Kind::kFault);
  Over(JobState::kCancelled, 103);
  EXPECT_EQ(Judge(104).kind, Kind::kLost);
  EXPECT_EQ(Judge(104).blame_node, "");
  Over(JobState::kDone, 103);
  EXPECT_EQ(Judge(104).blame_node, "n1") << "by itself, before it played";
  view_.heard = At(30);
  EXPECT_EQ(Judge(104).blame_node, "");
}

TEST_F(SlurmVerdict, AProgramThatCannotRunIsItsNodesDoing) {
  Run(10);
  Over(JobState::kFailed, 12);
  EXPECT_EQ(Judge(40).blame_node, "n1");
  Over(JobState::kPreempted, 12);
  EXPECT_EQ(Judge(40).blame_node, "");
}

}  // namespace
}  // namespace myograde::server
