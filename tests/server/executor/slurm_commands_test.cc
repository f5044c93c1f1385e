// Slurm's commands as they answer, fail, hang and print what they should not.
#include "server/executor/slurm/slurm_commands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/executor/slurm/batch_script.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

class SlurmCommandsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "slurm-commands-XXXXXX").string();
    folder_ = mkdtemp(name.data());
    config_.slurm_bin_dir = folder_;
  }
  void TearDown() override { fs::remove_all(folder_); }

  void Install(const std::string& name, const std::string& body) const {
    const fs::path path = folder_ / name;
    std::ofstream(path) << "#!/bin/sh\necho \"$@\" >" << folder_.string() << "/words\n" << body << "\n";
    fs::permissions(path, fs::perms::owner_all);
  }
  std::string Words() const {
    std::ostringstream text;
    text << std::ifstream(folder_ / "words").rdbuf();
    return text.str();
  }
  SlurmCommands Commands(absl::Duration deadline = absl::Seconds(20)) const {
    return {config_, "myograde-test", [this] { return stopped_; }, deadline};
  }

  fs::path folder_;
  SlurmConfig config_;
  bool stopped_ = false;
  const BatchOrder order_{"c0ffee", "#!/bin/sh\necho \"$0\"\n", 3, {30, 2048, 2}, {"n2", "n3"}};
};

TEST_F(SlurmCommandsTest, SubmitsWhatTheConfigSays) {
  config_.partition = "grading";
  config_.extra_options = {"--nice=5", "--requeue-later"};
  Install("sbatch", absl::StrCat("cat >", folder_.string(), "/script; echo '17;cluster'"));
  const auto job = Commands().Submit(order_);
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(*job, 17);
  for (const char* word :
       {"--partition=grading", "--nice=5", "--array=0-2", "--job-name=myograde-test",
        "--comment=c0ffee", "--no-requeue", "--time=30", "--mem=2048M", "--cpus-per-task=2",
        "--exclude=n2,n3", "--export=NONE"}) {
    EXPECT_THAT(Words(), HasSubstr(word));
  }
  EXPECT_THAT(Words(), Not(HasSubstr("--account")));
  std::ostringstream script;
  script << std::ifstream(folder_ / "script").rdbuf();
  EXPECT_EQ(script.str(), order_.script);
}

TEST_F(SlurmCommandsTest, ARefusalIsToldFromALostAnswer) {
  Install("sbatch", "echo 'sbatch: error: Batch job submission failed: Invalid account' >&2; exit 1");
  const absl::Status refused = Commands().Submit(order_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()),
              HasSubstr("sbatch: Batch job submission failed: Invalid account"));
  Install("sbatch", "echo 'sbatch: error: Batch job submission failed: Unable to contact slurm "
                    "controller (connect failure)' >&2; exit 1");
  EXPECT_TRUE(absl::IsUnavailable(Commands().Submit(order_).status()));
  for (const char* speechless : {"kill -9 $$", "exit 1"}) {
    Install("sbatch", speechless);
    EXPECT_TRUE(absl::IsUnavailable(Commands().Submit(order_).status())) << speechless;
  }
  Install("sbatch", "echo done");
  EXPECT_TRUE(absl::IsInternal(Commands().Submit(order_).status()));
}

TEST_F(SlurmCommandsTest, ACommandThatHangsIsKilled) {
  Install("sbatch", "exec sleep 1000");
  const Deadline deadline(absl::Seconds(10));
  const absl::Status status = Commands(absl::Seconds(0.3)).Submit(order_).status();
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  stopped_ = true;
  EXPECT_TRUE(absl::IsCancelled(Commands().Submit(order_).status()));
  EXPECT_FALSE(deadline.over());
}

TEST_F(SlurmCommandsTest, AMissingCommandIsNamed) {
  EXPECT_THAT(std::string(Commands().Queue().status().message()), HasSubstr("slurm_bin_dir"));
}

TEST_F(SlurmCommandsTest, NoVariableChangesWhatTheyShowOrDo) {
  Install("squeue", absl::StrCat("env >", folder_.string(), "/environment"));
  const std::map<std::string, std::string> variables = {
      {"SQUEUE_PARTITION", "other"}, {"SQUEUE_FORMAT", "%i"},  {"SBATCH_ACCOUNT", "other"},
      {"SCANCEL_STATE", "PENDING"},  {"SLURM_CLUSTERS", "x"},  {"SLURM_JOB_ID", "7"},
      {"POSIXLY_CORRECT", "1"},      {"SLURM_CONF", "/a/conf"}};
  for (const auto& [name, value] : variables) setenv(name.c_str(), value.c_str(), 1);
  EXPECT_TRUE(Commands().Queue().ok());
  for (const auto& [name, value] : variables) unsetenv(name.c_str());
  std::ostringstream environment;
  environment << std::ifstream(folder_ / "environment").rdbuf();
  EXPECT_THAT(environment.str(), HasSubstr("SLURM_CONF=/a/conf\n"));
  EXPECT_THAT(environment.str(), HasSubstr("PATH="));
  for (const auto& [name, value] : variables) {
    if (name == "SLURM_CONF") continue;
    EXPECT_THAT(environment.str(), Not(HasSubstr(name + "=")));
  }
}

TEST_F(SlurmCommandsTest, ReadsTheQueue) {
  Install("squeue", "echo '12|0|RUNNING|n1|c0ffee|0|None'\n"
                    "echo '12|1|PENDING||c0ffee|0|(Resources | Priority)'\n"
                    "echo '12|2|FAILED|n1|c0ffee|19456|NonZeroExitCode'\n"
                    "echo '13|N/A|RUNNING|n1|(null)|0|None'");
  const auto jobs = Commands().Queue();
  ASSERT_TRUE(jobs.ok()) << jobs.status();
  ASSERT_EQ(jobs->size(), 3u);
  EXPECT_EQ((*jobs)[0].id(), "12_0");
  EXPECT_EQ((*jobs)[0].node, "n1");
  EXPECT_EQ((*jobs)[0].batch, "c0ffee");
  EXPECT_EQ((*jobs)[1].state, JobState::kWaiting);
  EXPECT_EQ((*jobs)[1].reason, "(Resources | Priority)");
  EXPECT_EQ((*jobs)[2].wait_status, 76 << 8);
  EXPECT_THAT(Words(), HasSubstr("--name=myograde-test"));
  Install("squeue", "echo 'slurm_load_jobs error'");
  EXPECT_FALSE(Commands().Queue().ok());
  Install("squeue", "echo 12; exit 1");
  EXPECT_FALSE(Commands().Queue().ok()) << "half an answer is none";
}

TEST_F(SlurmCommandsTest, ReadsTheNodesThatGetJobs) {
  Install("sinfo", "echo 'n1|grading*|idle'; echo 'n2|grading*|down*'; echo 'n3|other|idle'\n"
                   "echo 'n4|grading*|drained'; echo 'n5|grading*|mixed'");
  const auto nodes = Commands().Nodes();
  ASSERT_TRUE(nodes.ok()) << nodes.status();
  EXPECT_EQ(*nodes, std::vector<std::string>({"n1", "n5"}));
}

TEST_F(SlurmCommandsTest, CancelsTasks) {
  Install("scancel", "");
  EXPECT_TRUE(Commands().Cancel({{.array = 12, .task = 0}, {.array = 13, .task = 4}}).ok());
  EXPECT_EQ(Words(), "--quiet 12_0 13_4\n");
}

TEST(BatchScript, IsOfLeasesAlone) {
  const std::string script = BatchScript({.program = "/opt/it's/myograde-node",
                                          .spool = "/shared/my spool",
                                          .url = "https://host:1",
                                          .ca_file = "/ca",
                                          .cache_dir = "/cache",
                                          .node_dir = "",
                                          .configs_dir = "/configs"},
                                         {{"1-1-aa", ""}, {"2-1-bb", ""}});
  EXPECT_THAT(script, HasSubstr("0) lease='1-1-aa' ;;\n1) lease='2-1-bb' ;;\n*) exit 64"));
  EXPECT_THAT(script, HasSubstr("exec '/opt/it'\\''s/myograde-node' --spool '/shared/my spool' "
                                "--lease \"$lease\" --cache '/cache' --configs '/configs'\n"));
  const std::string https = BatchScript(
      {.program = "/node", .spool = "", .url = "https://host:1", .ca_file = "/ca", .cache_dir = "",
       .node_dir = "/n", .configs_dir = ""},
      {{"1-1-aa", "t0ken"}});
  EXPECT_THAT(https, HasSubstr("export MYOGRADE_LEASE_TOKEN='t0ken'"));
  EXPECT_THAT(https, HasSubstr("--url 'https://host:1' --ca '/ca' --lease"));
}

}  // namespace
}  // namespace myograde::server
