// The executor between a stand-in for Slurm, whose commands are scripts, and a stand-in for nodes,
// which is this test: it writes into the spool what a node writes.
#include "server/executor/slurm/slurm_executor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "protocol/base/sha256.h"
#include "server/artefact/artefact.h"
#include "server/executor/slurm/slurm_runner.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const std::string kBuild = R"({"version":"test"})";

// Scripts that keep the queue in a file, a line a task, which the test edits.
class FakeSlurm {
 public:
  explicit FakeSlurm(fs::path folder) : folder_(std::move(folder)) {
    fs::create_directory(folder_);
    Queue("");
    Install("sbatch",
            "n=$(cat $d/number 2>/dev/null || echo 0); n=$((n + 1)); echo $n >$d/number\n"
            "for w in \"$@\"; do case $w in\n"
            "--array=0-*) last=${w#--array=0-} ;; --comment=*) batch=${w#--comment=} ;; esac; done\n"
            "echo \"$@\" >>$d/sbatch.words; cat >$d/script.$n\n"
            "for t in $(seq 0 $last); do echo \"$n|$t|PENDING||$batch|0|None\" >>$d/queue; done\n"
            "[ -e $d/swallow ] && sleep 1000\n"
            "echo $n");
    Install("squeue", "[ -e $d/down ] && { echo 'squeue: error: Unable to contact' >&2; exit 1; }\n"
                      "cat $d/queue");
    Install("scancel", "echo \"$@\" >>$d/cancelled");
  }
  std::string folder() const { return folder_.string(); }
  void Queue(const std::string& text) const {
    std::ofstream(folder_ / "queue.new") << text;
    fs::rename(folder_ / "queue.new", folder_ / "queue");
  }
  // Puts all tasks into this state, on a node, with the wait status of their script.
  void All(const std::string& state, const std::string& node = "n1", int status = 0) const {
    std::string text;
    for (const std::string& line : Lines("queue")) {
      const std::vector<std::string> parts = absl::StrSplit(line, '|');
      absl::StrAppend(&text, parts[0], "|", parts[1], "|", state, "|", node, "|", parts[4], "|", status, "|None\n");
    }
    Queue(text);
  }
  std::vector<std::string> Lines(const std::string& file) const {
    std::ifstream stream(folder_ / file);
    std::vector<std::string> lines;
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }
  void Set(const std::string& flag, bool on) const {
    if (on) std::ofstream(folder_ / flag) << "on";
    if (!on) fs::remove(folder_ / flag);
  }
  void Install(const std::string& name, const std::string& body) const {
    const fs::path path = folder_ / (name + ".new");
    std::ofstream(path) << "#!/bin/sh\nd=" << folder() << "\n" << body << "\n";
    fs::permissions(path, fs::perms::owner_all);
    fs::rename(path, folder_ / name);
  }

 private:
  const fs::path folder_;
};

class SlurmExecutorTest : public ::testing::Test {
 protected:
  SlurmExecutorTest() : slurm_(folder_.path() / "slurm") {
    for (const char* part : {"data", "data/logs", "shared"}) {
      fs::create_directory(folder_.path() / part);
    }
    WriteArchive(folder_ / "upload",
                 {{"policy.json", R"({"name": "a", "command": ["./run"]})"}, {"run", "#!/bin/sh\n", AE_IFREG | 0755}});
    const auto artefact = UnpackArtefact(folder_ / "upload", folder_ / "artefact", {});
    EXPECT_TRUE(artefact.ok()) << artefact.status();
    digest_ = artefact->digest;
    order_ = SomeNodeOrder().order;
    order_.artefact_dir = folder_ / "artefact";
    options_.config.slurm_bin_dir = slurm_.folder();
    options_.config.shared_dir = (folder_.path() / "shared").string();
    options_.config.poll = absl::Milliseconds(100);
    options_.store_id = "test";
    options_.data_dir = (folder_.path() / "data").string();
    options_.cache_dir = "/cache";
    options_.bin_dir = "/programs";
    options_.command_deadline = absl::Seconds(2);
    options_.grader = [](const std::vector<std::string>&) { return nlohmann::json::parse(kBuild); };
  }
  void Begin() {
    auto executor = SlurmExecutor::Make(options_);
    ASSERT_TRUE(executor.ok()) << executor.status();
    executor_ = *std::move(executor);
    Wait("it can start", [&] { return executor_->CannotStart().empty(); });
  }
  std::unique_ptr<Runner> Start(int64_t lease = 5) {
    auto runner = executor_->Start(order_, {.evaluation = 1,
                                            .lease = lease,
                                            .attempt = 1,
                                            .artefact = digest_,
                                            .runtimes = {},
                                            .wall = absl::Minutes(5)});
    EXPECT_TRUE(runner.ok()) << runner.status();
    return *std::move(runner);
  }
  template <typename Look>
  void Wait(const std::string& what, Look look) {
    const Deadline deadline(absl::Seconds(30));
    while (!look()) {
      if (executor_ != nullptr) executor_->Attend();
      ASSERT_FALSE(deadline.over()) << "not within 30 s: " << what;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  Spool OpenSpool() const {
    return *Spool::Open(options_.config.shared_dir + "/myograde-test");
  }
  // The folders of attempts that have an order.
  std::vector<std::string> Names() const { return *OpenSpool().Leases(); }
  LeaseFolder Claimed(const std::string& name, const std::string& build = kBuild) const {
    LeaseFolder lease = *OpenSpool().OpenLease(name);
    EXPECT_TRUE(lease.PutClaim({"n1", "1_0", 0, std::string(16, 'a')}).ok());
    NodeProof proof;
    proof.node = "n1";
    proof.processor = proof.kernel = proof.version = "test";
    proof.grader = build;
    EXPECT_TRUE(lease.PutProof(proof).ok());
    return lease;
  }
  static void Play(const LeaseFolder& lease, std::string text) {
    EXPECT_TRUE(lease.WriteRecords(0, text).ok());
    NodeEnd end;
    end.records_bytes = std::ssize(text);
    end.records_sha256 = Sha256Hex(text);
    end.cpu_s = 3;
    EXPECT_TRUE(lease.PutEnd(end).ok());
  }
  static std::string Records() {
    LeaseEndRecord end;
    end.ok = true;
    return absl::StrCat(LeaseRecordToLine(ProgressRecord{0, 1}), "\n", LeaseRecordToLine(end), "\n");
  }

  TestFolder folder_;
  FakeSlurm slurm_;
  LeaseOrder order_;
  std::string digest_;
  SlurmOptions options_;
  std::unique_ptr<SlurmExecutor> executor_;
};

TEST_F(SlurmExecutorTest, ALeaseGoesThroughAJobAndItsRecordsComeBack) {
  Begin();
  auto runner = Start();
  auto other = Start(6);
  Wait("both are submitted", [&] { return slurm_.Lines("queue").size() == 2; });
  EXPECT_THAT(slurm_.Lines("sbatch.words"), SizeIs(1)) << "as one array";
  EXPECT_FALSE(runner->begun());
  const std::vector<std::string> names = Names();
  ASSERT_EQ(names.size(), 2u);
  const NodeOrder sent = *OpenSpool().OpenLease(names[0])->Order();
  EXPECT_EQ(sent.order.artefact_dir, "");
  EXPECT_EQ(sent.artefact->digest, digest_);
  EXPECT_TRUE(*OpenSpool().HasArtefact(digest_));
  slurm_.All("RUNNING");
  const LeaseFolder lease = Claimed(names[0]);
  Wait("the node is known", [&] { return !executor_->Nodes().empty(); });
  Play(lease, Records());
  std::vector<LeaseRecord> records;
  Wait("it is finished", [&] {
    auto read = runner->Read();
    EXPECT_TRUE(read.ok()) << read.status();
    std::move(read->begin(), read->end(), std::back_inserter(records));
    return runner->finished();
  });
  EXPECT_TRUE(runner->begun());
  EXPECT_THAT(records, SizeIs(2));
  EXPECT_EQ(runner->site().node, "n1");
  EXPECT_EQ(runner->site().job, "1_0");
  EXPECT_EQ(runner->site().cpu_s, 3);
  EXPECT_EQ(runner->lost(), "");
  EXPECT_EQ(executor_->Nodes().front().state, "proved");
  runner.reset();
  slurm_.All("COMPLETED");
  Wait("its folder is removed", [&] { return Names().size() == 1; });
}

TEST_F(SlurmExecutorTest, ANodeWithAnotherBuildNeverCounts) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("RUNNING");
  Play(Claimed(Names()[0], R"({"version":"other"})"), Records());
  Wait("it is lost", [&] { return !runner->lost().empty(); });
  EXPECT_THAT(runner->lost(), HasSubstr("its version is other, and the daemon's is test"));
  EXPECT_THAT(*runner->Read(), IsEmpty());
  EXPECT_FALSE(runner->finished());
  ASSERT_THAT(executor_->TakeDrained(), SizeIs(1));
  runner.reset();
  auto next = Start(7);
  Wait("it is submitted elsewhere", [&] { return slurm_.Lines("sbatch.words").size() == 2; });
  EXPECT_THAT(slurm_.Lines("sbatch.words")[1], HasSubstr("--exclude=n1"));
}

TEST_F(SlurmExecutorTest, WhatComesFromAFolderThatWasAlteredIsNoResult) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("RUNNING");
  const LeaseFolder lease = Claimed(Names()[0]);
  EXPECT_TRUE(lease.WriteRecords(0, "{\"type\": \"nonsense\"}\n").ok());
  absl::Status status;
  Wait("it is noticed", [&] { return !(status = runner->Read().status()).ok(); });
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_FALSE(runner->finished());
}

TEST_F(SlurmExecutorTest, AJobThatIsPreemptedIsReturnedAndOneAtItsLimitIsAFault) {
  Begin();
  for (const char* state : {"PREEMPTED", "TIMEOUT"}) {
    auto runner = Start();
    Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
    slurm_.All("RUNNING");
    Claimed(Names()[0]);
    Wait("it is claimed", [&] { return runner->site().node == "n1"; });
    slurm_.All(state);
    Wait("it ends", [&] { return !runner->lost().empty() || runner->finished(); });
    if (state[0] == 'P') {
      EXPECT_THAT(runner->lost(), HasSubstr("job 1_0 on n1 was preempted"));
    } else {
      EXPECT_EQ(runner->lost(), "");
      EXPECT_TRUE(WIFSIGNALED(runner->wait_status()));
      EXPECT_THAT(runner->stderr_tail(), HasSubstr("reached its time limit"));
    }
    runner.reset();
    slurm_.Queue("");
    Wait("its folder is removed", [&] { return Names().empty(); });
  }
}

TEST_F(SlurmExecutorTest, AnAnswerOfSbatchThatIsLostMakesNoSecondJob) {
  Begin();
  slurm_.Set("swallow", true);
  auto runner = Start();
  Wait("it is in the queue", [&] { return !slurm_.Lines("queue").empty(); });
  Wait("the answer is lost", [&] { return !executor_->CannotStart().empty(); });
  slurm_.Set("swallow", false);
  Wait("the job is found", [&] { return runner->site().job == "1_0"; });
  EXPECT_THAT(slurm_.Lines("sbatch.words"), SizeIs(1));
}

TEST_F(SlurmExecutorTest, AClusterThatIsDownTakesNothingAndLosesNothing) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("RUNNING");
  const LeaseFolder lease = Claimed(Names()[0]);
  slurm_.Set("down", true);
  Wait("it is noticed", [&] { return !executor_->CannotStart().empty(); });
  EXPECT_THAT(executor_->CannotStart(), HasSubstr("the cluster does not answer"));
  EXPECT_EQ(runner->lost(), "");
  Play(lease, Records());
  Wait("it is finished", [&] {
    EXPECT_TRUE(runner->Read().ok());
    return runner->finished();
  });
  slurm_.Set("down", false);
  Wait("it is up", [&] { return executor_->CannotStart().empty(); });
}

TEST_F(SlurmExecutorTest, ALeaseThatIsEndedIsCancelledUntilItsJobIsGone) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("RUNNING");
  const LeaseFolder lease = Claimed(Names()[0]);
  Wait("it is claimed", [&] { return runner->site().node == "n1"; });
  runner->AskToEnd();
  Wait("the node is told", [&] { return lease.stopped().value_or(false); });
  Wait("Slurm is told again", [&] { return slurm_.Lines("cancelled").size() >= 3; });
  EXPECT_EQ(slurm_.Lines("cancelled")[0], "--quiet 1_0");
  EXPECT_FALSE(runner->dead());
  slurm_.All("CANCELLED");
  Wait("it is dead", [&] { return runner->dead(); });
  runner.reset();
  Wait("its folder is removed", [&] { return Names().empty(); });
}

TEST_F(SlurmExecutorTest, AStartEmptiesTheSpoolAndCancelsWhatAnEarlierDaemonSubmitted) {
  const Spool earlier = *Spool::Make(options_.config.shared_dir + "/myograde-test");
  EXPECT_TRUE(earlier.PutEpoch("earlier").ok());
  EXPECT_TRUE(earlier.MakeLease("4-1-0123456789abcdef").ok());
  slurm_.Queue("3|0|RUNNING|n1|earlier|0|None\n");
  Begin();
  EXPECT_NE(*OpenSpool().Epoch(), "earlier");
  EXPECT_THAT(Names(), IsEmpty());
  Wait("its job is cancelled", [&] { return !slurm_.Lines("cancelled").empty(); });
  EXPECT_EQ(slurm_.Lines("cancelled")[0], "--quiet 3_0");
}

TEST_F(SlurmExecutorTest, ADaemonThatIsHeldBackTouchesNeitherSpoolNorJobs) {
  options_.held_back = "it is a copy";
  slurm_.Queue("3|0|RUNNING|n1|original|0|None\n");
  for (const bool shared : {true, false}) {
    options_.config.shared_dir = shared ? (folder_.path() / "shared").string() : "";
    options_.config.url = shared ? "" : "https://127.0.0.1:1";
    auto executor = SlurmExecutor::Make(options_);
    ASSERT_TRUE(executor.ok()) << executor.status();
    (*executor)->Attend();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_EQ((*executor)->CannotStart(), "it is a copy");
    EXPECT_EQ((*executor)->door(), nullptr);
  }
  EXPECT_TRUE(fs::is_empty(folder_.path() / "shared"));
  EXPECT_FALSE(fs::exists(folder_.path() / "data/cluster"));
  EXPECT_THAT(slurm_.Lines("cancelled"), IsEmpty());
}

TEST_F(SlurmExecutorTest, ASpoolIsOneDaemonsAtATime) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("RUNNING");
  const LeaseFolder lease = Claimed(Names()[0]);
  const std::string epoch = *OpenSpool().Epoch();
  {
    auto second = SlurmExecutor::Make(options_);
    ASSERT_TRUE(second.ok()) << second.status();
    Wait("it is said", [&] {
      return (*second)->CannotStart().find("another daemon") != std::string::npos;
    });
    // Long enough to look at the queue, where the job is none of its own.
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
  EXPECT_THAT(slurm_.Lines("cancelled"), IsEmpty());
  EXPECT_EQ(*OpenSpool().Epoch(), epoch);
  EXPECT_TRUE(*lease.IsThere());
  runner.reset();
  executor_.reset();
  Begin();
  EXPECT_NE(*OpenSpool().Epoch(), epoch);
}

TEST_F(SlurmExecutorTest, ByHttpsAScriptHoldsTheTokenOfOneLease) {
  options_.config.shared_dir.clear();
  options_.config.url = "https://127.0.0.1:1";
  Begin();
  auto runner = Start();
  auto other = Start(6);
  Wait("both are submitted", [&] { return slurm_.Lines("queue").size() == 2; });
  for (const char* script : {"script.1", "script.2"}) {
    int tokens = 0;
    for (const std::string& line : slurm_.Lines(script)) {
      if (line.find("MYOGRADE_LEASE_TOKEN=") != std::string::npos) ++tokens;
    }
    EXPECT_EQ(tokens, 1) << script;
  }
}

TEST_F(SlurmExecutorTest, NothingStartsWhereAllNodesAreDrained) {
  slurm_.Install("sinfo", "echo 'n1|grading*|idle'; echo 'n2|grading*|idle'; echo 'n3|grading*|down'");
  Begin();
  EXPECT_TRUE(executor_->Drain("n1", "a fan is broken").ok());
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  EXPECT_EQ(executor_->CannotStart(), "");
  EXPECT_TRUE(executor_->Drain("n2", "new disks").ok());
  Wait("it is said", [&] { return !executor_->CannotStart().empty(); });
  EXPECT_THAT(executor_->CannotStart(), HasSubstr("n1: a fan is broken"));
  EXPECT_TRUE(executor_->Admit("n2").ok());
  EXPECT_EQ(executor_->CannotStart(), "");
}

TEST_F(SlurmExecutorTest, WhyANodeNeverTookItsLeaseIsSaid) {
  Begin();
  auto runner = Start();
  Wait("it is submitted", [&] { return !slurm_.Lines("queue").empty(); });
  slurm_.All("FAILED", "n1", kNodeUntrusted << 8);
  Wait("it is lost", [&] { return !runner->lost().empty(); });
  EXPECT_THAT(runner->lost(), HasSubstr("job 1_0 on n1 failed before it took its lease: the node does "
                                        "not trust the TLS certificate"));
}

TEST_F(SlurmExecutorTest, AFolderThatCannotBeWrittenIsSaid) {
  fs::remove_all(options_.config.shared_dir);
  auto executor = SlurmExecutor::Make(options_);
  ASSERT_TRUE(executor.ok());
  executor_ = *std::move(executor);
  Wait("it is said", [&] {
    return executor_->CannotStart().find(options_.config.shared_dir) != std::string::npos;
  });
  fs::create_directory(options_.config.shared_dir);
  Wait("it is there again", [&] { return executor_->CannotStart().empty(); });
}

TEST_F(SlurmExecutorTest, AnArtefactThatCannotBePackedIsTheLeasesTroubleAlone) {
  Begin();
  digest_ = std::string(64, '0');
  auto runner = Start();
  Wait("it is lost", [&] { return !runner->lost().empty(); });
  EXPECT_THAT(runner->lost(), HasSubstr("its order could not be written"));
  EXPECT_EQ(executor_->CannotStart(), "");
  EXPECT_THAT(Names(), IsEmpty());
}

}  // namespace
}  // namespace myograde::server
