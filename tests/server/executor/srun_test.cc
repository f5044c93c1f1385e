// What srun is told, and what squeue answers.
#include "server/executor/slurm/srun.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Srun, AJobAsksForWhatItsTrackMayUse) {
  Budgets budgets;
  budgets.memory_bytes = int64_t{2} << 30;
  budgets.scratch_bytes = 1;
  budgets.cpus = 1.5;
  EXPECT_THAT(JobWords({}, budgets, absl::Seconds(61)),
              ElementsAre("--nodes=1", "--ntasks=1", "--cpus-per-task=2", "--mem=3073M", "--time=12"));
  SlurmConfig config;
  config.time_limit_min = 5;
  config.memory_mib = 6;
  config.cpus = 7;
  config.partition = "grading";
  config.extra_options = {"--nice=5", "--time=1"};
  const std::vector<std::string> words = JobWords(config, budgets, absl::Seconds(61));
  EXPECT_THAT(words, ElementsAre("--nice=5", "--time=1", "--partition=grading", "--nodes=1",
                                 "--ntasks=1", "--cpus-per-task=7", "--mem=6M", "--time=5"));
}

TEST(Srun, ReadsTheQueue) {
  const auto jobs = ParseQueue(
      "12|RUNNING|n1|1-1-c0ffee|None\n13|PENDING||2-1-c0ffee|(Resources | Priority)  \n"
      "14|TIMEOUT|n1|3-1-c0ffee|TimeLimit\n15|PREEMPTED|n2|(null)|None\n16|SOMETHING_NEW|||\n");
  ASSERT_TRUE(jobs.ok()) << jobs.status();
  ASSERT_EQ(jobs->size(), 5u);
  EXPECT_EQ((*jobs)[0].id, "12");
  EXPECT_EQ((*jobs)[0].node, "n1");
  EXPECT_EQ((*jobs)[0].comment, "1-1-c0ffee");
  EXPECT_FALSE((*jobs)[0].over());
  EXPECT_FALSE((*jobs)[1].over());
  EXPECT_EQ((*jobs)[1].reason, "(Resources | Priority)");
  EXPECT_TRUE((*jobs)[2].over());
  EXPECT_TRUE((*jobs)[2].AtALimit());
  EXPECT_EQ((*jobs)[2].HowItEnded(), "reached its time limit");
  EXPECT_TRUE((*jobs)[3].over());
  EXPECT_FALSE((*jobs)[3].AtALimit());
  EXPECT_EQ((*jobs)[3].HowItEnded(), "was preempted");
  EXPECT_FALSE((*jobs)[4].over());
  EXPECT_THAT(std::string(ParseQueue("slurm_load_jobs error").status().message()),
              HasSubstr("slurm_load_jobs error"));
  EXPECT_TRUE(ParseQueue("")->empty());
  EXPECT_THAT(QueueWords("myograde-x"), Contains("--name=myograde-x"));
}

TEST(Srun, AMissingCommandIsNamed) {
  SlurmConfig config;
  config.slurm_bin_dir = "/nowhere";
  const absl::Status missing = SlurmCommand(config, "srun").status();
  EXPECT_TRUE(absl::IsFailedPrecondition(missing));
  EXPECT_THAT(std::string(missing.message()), HasSubstr("slurm_bin_dir"));
  config.slurm_bin_dir = "/bin";
  EXPECT_EQ(*SlurmCommand(config, "sh"), "/bin/sh");
}

}  // namespace
}  // namespace myograde::server
