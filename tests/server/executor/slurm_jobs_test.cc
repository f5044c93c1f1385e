// Whatever the cluster answers, late, twice or not at all: an attempt has one job, and every other is
// cancelled.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/executor/slurm/job_table.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr absl::Duration kStart = absl::Seconds(100);

class SlurmJobs : public ::testing::Test {
 protected:
  void Add(const std::string& name, int64_t evaluation = 1) {
    table_.Add(name, evaluation, {10, 100, 1}, now_);
  }
  void Pass(double seconds) { now_ += absl::Seconds(seconds); }
  JobTable::Batch Next() {
    Pass(0.2);
    auto batch = table_.Next(now_);
    EXPECT_TRUE(batch.has_value());
    return batch.value_or(JobTable::Batch());
  }
  std::vector<std::string> See(std::vector<SlurmJob> jobs) {
    Pass(2);
    std::vector<std::string> strays;
    for (const SlurmJob& job : table_.See(jobs, now_)) strays.push_back(job.id());
    return strays;
  }
  std::vector<std::string> Strays() {
    std::vector<std::string> strays;
    for (const SlurmJob& job : table_.TakeStrays()) strays.push_back(job.id());
    return strays;
  }
  static SlurmJob Job(int64_t array, int64_t task, JobState state, std::string batch = "") {
    return {array, task, state, "n1", std::move(batch), ""};
  }

  JobTable table_{3};
  absl::Duration now_ = kStart;
};

TEST_F(SlurmJobs, LeasesOfAnEvaluationShareAnArrayThatIsNotTooLarge) {
  for (const char* name : {"1-1-a", "2-1-a", "3-1-a", "4-1-a"}) Add(name);
  Add("5-1-a", 2);
  EXPECT_FALSE(table_.Next(now_).has_value()) << "more may come in this turn";
  EXPECT_EQ(table_.next_at(), now_ + JobTable::kGather);
  const JobTable::Batch first = Next();
  EXPECT_THAT(first.names, ElementsAre("1-1-a", "2-1-a", "3-1-a"));
  table_.Accepted(first, 7);
  const JobTable::Batch second = Next();
  EXPECT_THAT(second.names, ElementsAre("4-1-a"));
  table_.Accepted(second, 8);
  EXPECT_THAT(Next().names, ElementsAre("5-1-a"));
  EXPECT_EQ(table_.Find("3-1-a")->id, "7_2");
  EXPECT_EQ(table_.Find("4-1-a")->id, "8_0");
}

TEST_F(SlurmJobs, ARefusedSubmissionIsTriedAgainLaterAndLater) {
  Add("1-1-a");
  absl::Duration wait = JobTable::kRetry;
  for (int i = 0; i < 6; ++i) {
    table_.Refused(Next(), "no such partition", now_);
    EXPECT_EQ(table_.trouble(), "no such partition");
    EXPECT_EQ(table_.next_at(), now_ + wait);
    EXPECT_FALSE(table_.Next(now_ + wait - absl::Seconds(1)).has_value());
    now_ += wait;
    wait = std::min(2 * wait, JobTable::kMostRetry);
  }
  EXPECT_EQ(table_.trouble_since(), kStart + JobTable::kGather);
  table_.Accepted(Next(), 7);
  EXPECT_EQ(table_.trouble(), "");
}

TEST_F(SlurmJobs, AnAnswerThatWasLostIsLookedForAndNothingIsSubmittedTwice) {
  Add("1-1-a");
  table_.Lost(Next(), "comment", "sbatch was not done after 30 s", now_);
  Pass(10);
  EXPECT_FALSE(table_.Next(now_).has_value()) << "whether there is a job is not known";
  EXPECT_THAT(See({Job(7, 0, JobState::kRunning, "comment")}), IsEmpty());
  EXPECT_EQ(table_.Find("1-1-a")->id, "7_0");
  EXPECT_FALSE(table_.Next(now_ + absl::Hours(1)).has_value());
  EXPECT_EQ(table_.trouble(), "") << "the cluster took it";
  EXPECT_EQ(table_.next_at(), absl::InfiniteDuration());
}

TEST_F(SlurmJobs, TroubleDoesNotOutlastThoseWhoWouldNoticeItsEnd) {
  Add("1-1-a");
  table_.Refused(Next(), "no such partition", now_);
  table_.Remove("1-1-a", /*leaves=*/false, now_);
  EXPECT_EQ(table_.trouble(), "") << "nobody would ever submit again";
  Add("2-1-a");
  EXPECT_EQ(table_.trouble(), "no such partition");
  Pass(5);
  const JobTable::Batch batch = Next();
  EXPECT_EQ(table_.trouble(), "no such partition") << "it is not answered yet";
  table_.Accepted(batch, 7);
  EXPECT_EQ(table_.trouble(), "");
}

TEST_F(SlurmJobs, ALostSubmissionThatTheQueueDoesNotShowIsMadeAgainAndAStrayIfItComesLate) {
  Add("1-1-a");
  const JobTable::Batch batch = Next();
  table_.Lost(batch, "comment", "sbatch was not done after 30 s", now_);
  // Asked before, an answer says nothing.
  EXPECT_THAT(table_.See({}, now_ - absl::Seconds(1)), IsEmpty());
  Pass(5);
  EXPECT_FALSE(table_.Next(now_).has_value());
  EXPECT_THAT(See({}), IsEmpty());
  Pass(5);
  table_.Accepted(Next(), 9);
  EXPECT_THAT(See({Job(8, 0, JobState::kRunning, "comment"), Job(9, 0, JobState::kWaiting, "b")}),
              ElementsAre("8_0"));
}

TEST_F(SlurmJobs, AJobIsOverWhenTheQueueSaysSoOrForgetsItTwice) {
  Add("1-1-a");
  Add("2-1-a");
  table_.Accepted(Next(), 7);
  See({Job(7, 0, JobState::kRunning), Job(7, 1, JobState::kNodeLost)});
  EXPECT_EQ(table_.Find("2-1-a")->over_since, now_);
  EXPECT_FALSE(table_.Find("2-1-a")->missing);
  See({});
  EXPECT_EQ(table_.Find("1-1-a")->over_since, absl::InfiniteDuration());
  See({});
  EXPECT_EQ(table_.Find("1-1-a")->over_since, now_);
  EXPECT_TRUE(table_.Find("1-1-a")->missing);
  // It had only been left out.
  See({Job(7, 0, JobState::kRunning)});
  EXPECT_EQ(table_.Find("1-1-a")->over_since, absl::InfiniteDuration());
}

TEST_F(SlurmJobs, WhatIsNotWantedIsCancelledUntilItIsGone) {
  Add("1-1-a");
  Add("2-1-a");
  table_.Accepted(Next(), 7);
  See({Job(7, 0, JobState::kRunning), Job(7, 1, JobState::kRunning)});
  table_.Remove("1-1-a", /*leaves=*/false, now_);
  EXPECT_THAT(Strays(), ElementsAre("7_0"));
  EXPECT_FALSE(table_.gone("1-1-a", now_));
  // The cancel was lost, or takes its time.
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(See({Job(7, 0, JobState::kRunning), Job(7, 1, JobState::kRunning)}),
                ElementsAre("7_0"));
  }
  EXPECT_THAT(See({Job(7, 0, JobState::kEnding), Job(7, 1, JobState::kRunning)}), IsEmpty());
  EXPECT_FALSE(table_.gone("1-1-a", now_));
  See({Job(7, 0, JobState::kCancelled), Job(7, 1, JobState::kRunning)});
  EXPECT_TRUE(table_.gone("1-1-a", now_));
}

TEST_F(SlurmJobs, NobodyWaitsForEverForAJobThatDoesNotGo) {
  Add("1-1-a");
  table_.Accepted(Next(), 7);
  See({Job(7, 0, JobState::kRunning)});
  table_.Remove("1-1-a", /*leaves=*/false, now_);
  Pass(absl::ToDoubleSeconds(JobTable::kForget));
  EXPECT_TRUE(table_.gone("1-1-a", now_));
  table_.Forget("1-1-a");
  // Its zombie is cancelled whenever it is seen.
  EXPECT_THAT(See({Job(7, 0, JobState::kRunning)}), ElementsAre("7_0"));
}

TEST_F(SlurmJobs, WhatAnEarlierDaemonSubmittedIsCancelled) {
  EXPECT_THAT(See({Job(3, 0, JobState::kWaiting), Job(3, 1, JobState::kRunning),
                   Job(3, 2, JobState::kDone)}),
              ElementsAre("3_0", "3_1"));
}

TEST_F(SlurmJobs, AttemptsThatEndBeforeTheirSubmissionNeedNone) {
  Add("1-1-a");
  table_.Remove("1-1-a", /*leaves=*/false, now_);
  EXPECT_TRUE(table_.gone("1-1-a", now_));
  Pass(1);
  EXPECT_FALSE(table_.Next(now_).has_value());
  // And those that end while it is under way are cancelled with its answer.
  Add("2-1-a");
  const JobTable::Batch batch = Next();
  table_.Remove("2-1-a", /*leaves=*/false, now_);
  EXPECT_FALSE(table_.gone("2-1-a", now_));
  table_.Accepted(batch, 7);
  EXPECT_THAT(Strays(), ElementsAre("7_0"));
}

TEST_F(SlurmJobs, AJobWhoseNodeHasSaidItsLastWordIsGivenTimeToLeave) {
  Add("1-1-a");
  table_.Accepted(Next(), 7);
  See({Job(7, 0, JobState::kRunning)});
  table_.Remove("1-1-a", /*leaves=*/true, now_);
  EXPECT_THAT(Strays(), IsEmpty());
  EXPECT_THAT(See({Job(7, 0, JobState::kRunning)}), IsEmpty());
  Pass(absl::ToDoubleSeconds(JobTable::kLeave));
  EXPECT_THAT(See({Job(7, 0, JobState::kRunning)}), ElementsAre("7_0"));
}

TEST(JobStateOf, KnowsWhatSlurmSays) {
  EXPECT_EQ(JobStateOf("PENDING"), JobState::kWaiting);
  EXPECT_EQ(JobStateOf("REQUEUED"), JobState::kWaiting);
  EXPECT_EQ(JobStateOf("COMPLETING"), JobState::kEnding);
  EXPECT_EQ(JobStateOf("OUT_OF_MEMORY"), JobState::kMemory);
  EXPECT_EQ(JobStateOf("DEADLINE"), JobState::kTimeLimit);
  EXPECT_TRUE(IsOver(JobStateOf("A_STATE_OF_LATER_VERSIONS")));
}

}  // namespace
}  // namespace myograde::server
