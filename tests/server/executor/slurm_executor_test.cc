// The executor and the process that looks after a lease, with a stand-in for Slurm: srun is a script
// that plays the node.
#include "server/executor/slurm/slurm_executor.h"

#include <signal.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "server/artefact/artefact.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

// What srun's script begins with. `say` sends a message of the node's, and `hear` waits for one.
constexpr char kNode[] = R"(
import json, os, signal, sys, time
folder = os.path.dirname(sys.argv[0])
comment = next(word[10:] for word in sys.argv if word.startswith("--comment="))
with open(folder + "/words", "a") as file:
    file.write(" ".join(sys.argv[1:]) + "\n")

def job(state, node="n1", reason="None"):
    with open(folder + "/queue", "w") as file:
        # Beside one that was refused earlier.
        file.write(f"6|FAILED||{comment}|None\n7|{state}|{node}|{comment}|{reason}\n"
                   f"5|FAILED||{comment}|None\n")

def say(kind, data=b""):
    data = data.encode() if isinstance(data, str) else data
    sys.stdout.buffer.write(b"%s %d\n%s\n" % (kind.encode(), len(data), data))
    sys.stdout.buffer.flush()

def node(**more):
    say("node", json.dumps({"type": "node", "node": "n1", "job": "7", "cpu_s": 0, **more}))

def hear():
    kind, size = sys.stdin.buffer.readline().split()
    data = sys.stdin.buffer.read(int(size))
    sys.stdin.buffer.read(1)
    return kind.decode(), data

LAST = ('{"detail":"","ok":true,"peak_memory_bytes":0,"policy_cpu_s":0,"simulator_cpu_s":0,'
        '"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,'
        '"type":"lease_end","wall_s":1}')

def progress():
    say("record", '{"episode":0,"step":1,"type":"progress"}')

def end(status=0, said="", record=LAST):
    say("end", json.dumps({"wait_status": status, "said": said, "record": record}))

def fail(text, status=1):
    print("srun: error: " + text, file=sys.stderr)
    sys.exit(status)

)";

class SlurmExecutorTest : public ::testing::Test {
 protected:
  SlurmExecutorTest() {
    setenv("MYOGRADE_BIN_DIR", MYOGRADE_BIN_DIR, 1);
    for (const char* part : {"slurm", "work", "logs"}) fs::create_directory(folder_.path() / part);
    WriteArchive(folder_ / "upload", {{"policy.json", R"({"name": "a", "command": ["./run"]})"},
                                      {"run", "#!/bin/sh\n", AE_IFREG | 0755}});
    const auto artefact = UnpackArtefact(folder_ / "upload", folder_ / "artefact", {});
    EXPECT_TRUE(artefact.ok()) << artefact.status();
    digest_ = artefact->digest;
    order_.lease = "5-1";
    order_.command = {"./run"};
    order_.artefact_dir = folder_ / "artefact";
    order_.log_dir = folder_ / "logs";
    order_.track =
        LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "elbow", "").value();
    order_.episodes = {{.index = 0, .seed = 1, .policy_seed = 2}};
    options_.config.slurm_bin_dir = folder_ / "slurm";
    options_.store_id = "test";
    options_.cache_dir = "/cache";
    options_.configs_dir = "/configs";
    options_.bin_dir = "/programs";
    options_.log_bytes = 1 << 20;
    options_.grader = [](const std::vector<std::string>&) {
      return nlohmann::json{{"version", "test"}};
    };
    Install("squeue", "cat $d/queue 2>/dev/null || true");
    Install("scancel", "echo \"$@\" >>$d/cancelled");
    Install("sinfo", "echo 'n1|grading*|idle'; echo 'n2|grading*|down*'; echo 'n3|other|idle'");
    Srun("node(); hear(); node(processor='a processor'); progress(); node(cpu_s=3, energy_j=5); end()");
  }
  void Install(const std::string& name, const std::string& body) const {
    Put(name, absl::StrCat("#!/bin/sh\nd=", folder_ / "slurm", "\n", body, "\n"));
  }
  void Srun(const std::string& body) const {
    Put("srun", absl::StrCat("#!/usr/bin/python3 -B", kNode, body, "\n"));
  }
  void Put(const std::string& name, const std::string& text) const {
    const fs::path path = folder_.path() / "slurm" / name;
    ASSERT_TRUE(WriteFile(path.string() + ".new", text).ok());
    fs::permissions(path.string() + ".new", fs::perms::owner_all);
    fs::rename(path.string() + ".new", path);
  }
  std::string Text(const std::string& file) const {
    return ReadFile(folder_ / ("slurm/" + file)).value_or("");
  }
  void Begin() {
    executor_ = std::make_unique<SlurmExecutor>(options_);
    Wait("it can start", [&] { return executor_->CannotStart().empty(); });
  }
  std::unique_ptr<Runner> Start(int64_t lease = 5) {
    order_.work_dir = folder_ / absl::StrCat("work/", lease);
    auto runner = executor_->Start(
        order_, {.artefact = digest_, .runtimes = {}, .wall = absl::Minutes(5)});
    EXPECT_TRUE(runner.ok()) << runner.status();
    return *std::move(runner);
  }
  template <typename Look>
  void Wait(const std::string& what, Look look) {
    const Deadline deadline(absl::Seconds(60));
    while (!look()) {
      ASSERT_FALSE(deadline.over()) << "not within a minute: " << what;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  // All records until it is finished, lost or broken.
  std::vector<LeaseRecord> Follow(Runner& runner) {
    std::vector<LeaseRecord> all;
    Wait("it ends", [&] {
      auto records = runner.Read();
      if (!records.ok()) {
        broken_ = std::string(records.status().message());
        return true;
      }
      std::move(records->begin(), records->end(), std::back_inserter(all));
      return runner.finished() || !runner.lost().empty();
    });
    return all;
  }

  TestFolder folder_;
  LeaseOrder order_;
  std::string digest_;
  SlurmOptions options_;
  std::unique_ptr<SlurmExecutor> executor_;
  std::string broken_;
};

TEST_F(SlurmExecutorTest, ALeaseGoesThroughAJobAndItsRecordsComeBack) {
  Begin();
  auto runner = Start();
  EXPECT_FALSE(runner->begun());
  EXPECT_THAT(Follow(*runner), SizeIs(2));
  EXPECT_TRUE(runner->begun());
  EXPECT_EQ(runner->wait_status(), 0) << runner->stderr_tail();
  EXPECT_EQ(runner->site().node, "n1");
  EXPECT_EQ(runner->site().job, "7");
  EXPECT_EQ(runner->site().cpu_s, 3);
  EXPECT_EQ(runner->site().energy_j, 5);
  EXPECT_EQ(runner->lost(), "");
  executor_->NoteEnd("n1", /*fault=*/false);
  const NodeView node = executor_->Nodes().front();
  EXPECT_EQ(node.state, "proved");
  EXPECT_EQ(node.processor, "a processor");
  EXPECT_EQ(node.running, 1);
  EXPECT_EQ(node.done, 1);
  runner.reset();
  EXPECT_EQ(executor_->Nodes().front().running, 0);
  for (const char* word : {"--time=", "--mem=", "--job-name=myograde-test", "--comment=5-1-",
                           "--export=NONE", "/programs/myograde-node --play --cache /cache "
                                            "--configs /configs"}) {
    EXPECT_THAT(Text("words"), HasSubstr(word));
  }
  EXPECT_THAT(Text("words"), Not(HasSubstr("--exclude")));
  executor_->CleanUp(order_.work_dir);
  EXPECT_TRUE(fs::is_empty(folder_.path() / "work"));
}

TEST_F(SlurmExecutorTest, ANodeGetsTheSubmissionThatItLacksAndItsLogsAreKept) {
  Srun(R"(
node(); kind, order = hear()
assert kind == "order" and json.loads(order)["order"]["episodes"][0]["seed"] == 1
say("want")
data = b""
while piece := hear()[1]:
    data += piece
open(folder + "/tar", "wb").write(data)
say("log", b"ab" * 32 + b"\n" + b"\0log\n")
progress(); end())");
  Begin();
  auto runner = Start();
  EXPECT_THAT(Follow(*runner), SizeIs(2));
  EXPECT_THAT(Text("tar"), HasSubstr("policy.json"));
  std::string name;
  for (int i = 0; i < 32; ++i) name += "ab";
  EXPECT_EQ(ReadFile(folder_ / ("logs/" + name + ".lcmlog.zst")).value_or(""),
            std::string("\0log\n", 5));
}

TEST_F(SlurmExecutorTest, HowAJobEndedDecidesWhoseFaultItIs) {
  Begin();
  struct Case {
    const char* state;
    const char* words;
    bool fault;
  };
  for (const auto& [state, words, fault] :
       {Case{"PREEMPTED", "was preempted before its lease had ended", false},
        Case{"NODE_FAIL", "was lost with its node", false}, Case{"CANCELLED", "was cancelled", false},
        Case{"TIMEOUT", "reached its time limit", true},
        Case{"OUT_OF_MEMORY", "used more memory", true}}) {
    Srun(absl::StrCat("node(); hear(); progress(); job('", state, "'); fail('it ended')"));
    auto runner = Start();
    EXPECT_THAT(Follow(*runner), SizeIs(1)) << state;
    const std::string said = absl::StrCat("job 7 on n1 ", words);
    EXPECT_THAT(fault ? runner->stderr_tail() : runner->lost(), HasSubstr(said));
    EXPECT_EQ(runner->lost().empty(), fault) << state;
    EXPECT_EQ(runner->wait_status() != 0, fault) << state;
  }
  EXPECT_EQ(executor_->Nodes().front().faults, 0);
}

TEST_F(SlurmExecutorTest, ARunnerThatDiesOnItsNodeIsTheGradersFaultInItsOwnWords) {
  Srun("node(); hear(); progress(); end(11, 'it fell', '')");
  Begin();
  auto runner = Start();
  EXPECT_THAT(Follow(*runner), SizeIs(1));
  EXPECT_NE(runner->wait_status(), 0);
  EXPECT_THAT(runner->stderr_tail(), HasSubstr("it fell"));
  EXPECT_THAT(runner->stderr_tail(), HasSubstr("signal 11"));
}

TEST_F(SlurmExecutorTest, AnUnfitNodeIsDrainedAndExcluded) {
  Srun("node(); hear(); node(unfit='it has another grader', lost='the node gave it back'); "
       "end(record='')");
  Begin();
  auto runner = Start();
  EXPECT_THAT(Follow(*runner), IsEmpty());
  EXPECT_THAT(runner->lost(), HasSubstr("it has another grader"));
  EXPECT_EQ(executor_->Nodes().front().state, "drained");
  EXPECT_THAT(executor_->TakeDrained(), SizeIs(1));
  auto second = Start(6);
  EXPECT_THAT(Follow(*second), IsEmpty());
  EXPECT_THAT(second->lost(), HasSubstr("is drained")) << "though Slurm gave it to that node";
  EXPECT_THAT(Text("words"), HasSubstr("--exclude=n1"));
  Wait("all nodes are drained or down", [&] {
    return absl::StrContains(executor_->CannotStart(), "all nodes of the cluster are drained or down");
  });
  EXPECT_TRUE(executor_->Admit("n1").ok());
  EXPECT_EQ(executor_->CannotStart(), "");
}

TEST_F(SlurmExecutorTest, NodesThatNeverComeToPlayAreDrained) {
  Srun("job('FAILED'); fail('n1: task 0: Exited with exit code 2')");
  Begin();
  for (int i = 0; i < NodeHealth::kMostBadEnds; ++i) {
    EXPECT_EQ(executor_->CannotStart(), "");
    auto runner = Start();
    Follow(*runner);
    EXPECT_THAT(runner->lost(), HasSubstr("job 7 on n1 failed before it took its lease: srun: n1: task 0"));
  }
  EXPECT_EQ(executor_->Nodes().front().state, "drained");
}

TEST_F(SlurmExecutorTest, AClusterThatTakesNoJobsIsAskedAgainAndNothingStartsMeanwhile) {
  Srun("fail('Unable to allocate resources: Invalid account')");
  Begin();
  auto runner = Start();
  Wait("it is said", [&] {
    EXPECT_TRUE(runner->Read().ok());
    return absl::StrContains(executor_->CannotStart(), "the cluster takes no jobs: srun: Unable to "
                                                       "allocate resources: Invalid account");
  });
  Srun("node(); hear(); progress(); end()");
  EXPECT_THAT(Follow(*runner), SizeIs(2));
  EXPECT_EQ(executor_->CannotStart(), "");
}

TEST_F(SlurmExecutorTest, AJobThatWaitsForTooLongIsGivenUp) {
  options_.config.queue_wait = absl::Seconds(1);
  Srun("job('PENDING', '', 'Resources'); time.sleep(1000)");
  Begin();
  auto runner = Start();
  EXPECT_THAT(Follow(*runner), IsEmpty());
  EXPECT_THAT(runner->lost(), HasSubstr("job 7 had not begun after 1 s (Resources)"));
}

TEST_F(SlurmExecutorTest, ALeaseThatIsEndedEndsItsJob) {
  const std::string begin =
      "signal.signal(signal.SIGTERM, lambda *_: (open(folder + '/ended', 'w').write('x'), os._exit(0)))\n"
      "node(); hear(); progress()\ntime.sleep(1000)";
  for (const bool kill : {false, true}) {
    fs::remove(folder_ / "slurm/ended");
    Srun(begin);
    Begin();
    auto runner = Start();
    Wait("it plays", [&] { return !runner->Read()->empty(); });
    if (kill) {
      ::kill(runner->pid(), SIGKILL);
    } else {
      runner->AskToEnd();
    }
    Wait("it is dead", [&] { return runner->dead(); });
    Wait("its job was ended", [&] { return !Text("ended").empty(); });
  }
}

TEST_F(SlurmExecutorTest, WhatIsNoLeaseIsAFault) {
  Begin();
  for (const char* what : {"print('hello, this is some other program', flush=True)", "say('node', '{}')",
                           "say('log', 'x')", "say('end', '{}')", "say('music')",
                           "say('record', 'no json')"}) {
    Srun(absl::StrCat("node(); hear(); ", what, "; end()"));
    auto runner = Start();
    Follow(*runner);
    EXPECT_TRUE(!broken_.empty() || runner->wait_status() != 0) << what;
    broken_.clear();
  }
}

TEST_F(SlurmExecutorTest, AnArtefactThatWasAlteredIsTheGradersFault) {
  ASSERT_TRUE(WriteFile(folder_ / "artefact/run", "#!/bin/false\n").ok());
  Srun("node(); hear(); say('want'); time.sleep(1000)");
  Begin();
  auto runner = Start();
  Follow(*runner);
  EXPECT_NE(runner->wait_status(), 0);
  EXPECT_THAT(runner->stderr_tail(), HasSubstr("restore it from a backup"));
}

TEST_F(SlurmExecutorTest, JobsThatNoLeaseWaitsForAreCancelled) {
  ASSERT_TRUE(WriteFile(folder_ / "slurm/queue", "3|RUNNING|n1|1-1-dead|None\n4|PENDING||2-1-dead|None\n"
                                                 "5|COMPLETED|n1|3-1-dead|None\n").ok());
  Install("scancel", "echo 'scancel: error: Unable to contact slurm controller' >&2; exit 1");
  executor_ = std::make_unique<SlurmExecutor>(options_);
  Wait("it says why nothing starts", [&] {
    return executor_->CannotStart() ==
           "the cluster does not answer: scancel: Unable to contact slurm controller";
  });
  Install("scancel", "echo \"$@\" >>$d/cancelled; : >$d/queue");
  Wait("it can start", [&] { return executor_->CannotStart().empty(); });
  EXPECT_EQ(Text("cancelled"), "--quiet 3 4\n");
  // One of a lease that goes on is none of these.
  Srun("job('RUNNING'); node(); hear(); progress(); time.sleep(1000)");
  auto runner = Start();
  Wait("it plays", [&] { return !runner->Read()->empty(); });
  EXPECT_TRUE(executor_->Drain("n9", "so that it looks soon").ok());
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_EQ(Text("cancelled"), "--quiet 3 4\n");
}

TEST_F(SlurmExecutorTest, ADaemonThatIsHeldBackTouchesNoJob) {
  options_.held_back = "this is a copy";
  executor_ = std::make_unique<SlurmExecutor>(options_);
  EXPECT_EQ(executor_->CannotStart(), "this is a copy");
  executor_.reset();
  EXPECT_EQ(Text("cancelled"), "");
}

TEST_F(SlurmExecutorTest, OnlySubmissionsRunThere) {
  Begin();
  const LeaseSubject nothing = {.artefact = "", .runtimes = {}, .wall = absl::Minutes(1)};
  EXPECT_TRUE(absl::IsFailedPrecondition(executor_->Start(order_, nothing).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(executor_->Drain("a/b", "why")));
  EXPECT_TRUE(absl::IsInvalidArgument(executor_->Admit("..")));
}

}  // namespace
}  // namespace myograde::server
