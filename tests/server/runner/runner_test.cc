// Whole leases with the real simulator, bridge and sandboxes: the outcomes of correct and broken
// policies, and that a lease leaves nothing behind.
#include "server/sandbox/slot_processes.h"
#include "tests/server/runner/runner_world.h"

namespace myograde::server {
namespace {

TEST_F(RunnerTest, PlaysTheZeroPolicyTheSameTwice) {
  const LeaseOrder order = BundledOrder("zero", "locomotion", 2);
  const Outcomes first = Play(order);
  const Outcomes second = Play(order);
  ASSERT_EQ(first.episodes.size(), 2u) << first.end->detail;
  ASSERT_EQ(second.episodes.size(), 2u) << second.end->detail;
  EXPECT_TRUE(first.end->ok);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_NE(first.episodes[i].end, EpisodeEnd::kFault) << first.episodes[i].fault.detail;
    EXPECT_EQ(first.episodes[i].digest, second.episodes[i].digest);
  }
  EXPECT_NE(first.episodes[0].digest, first.episodes[1].digest);
  EXPECT_GT(first.end->policy_cpu_s, 0);
}

TEST_F(RunnerTest, PlaysTheRandomPolicyOnTheArm) {
  const Outcomes outcomes = Play(BundledOrder("random", "manipulation", 1));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_NE(outcomes.episodes[0].end, EpisodeEnd::kFault) << outcomes.episodes[0].fault.detail;
  EXPECT_GT(outcomes.episodes[0].steps, 0);
}

TEST_F(RunnerTest, PolicyThatNeverShowsUp) {
  const Outcomes outcomes = Play(ScriptOrder("exec sleep 1000"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kInitTimeout);
}

TEST_F(RunnerTest, PolicyThatEndsAtOnceGetsItsLastWordsTold) {
  const Outcomes outcomes = Play(ScriptOrder("echo out; echo no such model >&2; exit 7", 3));
  ASSERT_EQ(outcomes.episodes.size(), 3u) << outcomes.end->detail;
  EXPECT_TRUE(outcomes.end->ok);
  for (const EpisodeFacts& facts : outcomes.episodes) {
    EXPECT_EQ(facts.fault.outcome, Outcome::kCrash);
    EXPECT_THAT(facts.fault.detail, HasSubstr("7"));
    EXPECT_THAT(facts.fault.detail, HasSubstr("no such model"));
  }
  // Started twice: restarts is 1.
  EXPECT_EQ(outcomes.end->stdout_tail, "out\nout\n");
}

TEST_F(RunnerTest, AnAgentOfTheTemplateIsToldOfItsAdapter) {
  LeaseOrder order = ScriptOrder("echo 'grpc: unavailable' >&2; echo '>' >&2; exit 1");
  fs::create_directories(root_ + "/policy/agent");
  std::ofstream(root_ + "/policy/agent/evaluation_pb2_grpc.py");
  const Outcomes outcomes = Play(order);
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  const std::string& detail = outcomes.episodes[0].fault.detail;
  EXPECT_THAT(detail, HasSubstr("the last line of its stderr: grpc: unavailable;"));
  EXPECT_THAT(detail, HasSubstr("\"adapter\": \"template-2024\""));
  LeaseOrder older = Order("baoding", 1);
  older.command = order.command;
  const Outcomes balls = Play(older);
  ASSERT_EQ(balls.episodes.size(), 1u);
  EXPECT_THAT(balls.episodes[0].fault.detail, HasSubstr("\"adapter\": \"template-2022\""));
}

TEST_F(RunnerTest, AnImageThatCantBeShownIsTheParticipantsFault) {
  LeaseOrder order = ScriptOrder("exit 0");
  // What the upload refuses, from an artefact of an earlier version.
  fs::create_directories(root_ + "/policy/image/etc");
  for (int i = 0; i < 600; ++i) std::ofstream(absl::StrCat(root_, "/policy/image/name", i));
  order.image = PolicyImage{{}, "/", 1000, 1000};
  const Outcomes outcomes = Play(order);
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.episodes[0].fault.detail, HasSubstr("the image has more than 512 names"));
  EXPECT_TRUE(outcomes.end->ok);
}

TEST_F(RunnerTest, PolicyThatIsNotExecutable) {
  LeaseOrder order = ScriptOrder("exit 0");
  fs::permissions(root_ + "/policy/run", fs::perms(0644));
  const Outcomes outcomes = Play(order);
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
}

// The dynamic loader names the first library that it does not find.
TEST_F(RunnerTest, PolicyWithoutItsLibraryIsToldWhatIsMissingAndWhereItBelongs) {
  std::ifstream shell("/bin/sh", std::ios::binary);
  std::string program((std::istreambuf_iterator<char>(shell)), {});
  const std::string known("libc.so.6\0", 10);
  const std::string unknown("libq.so.6\0", 10);
  ASSERT_NE(program.find(known), std::string::npos) << "this host's shell is linked in another way";
  for (size_t at; (at = program.find(known)) != std::string::npos;) {
    program.replace(at, known.size(), unknown);
  }
  LeaseOrder order = ScriptOrder("exec ./program");
  std::ofstream(root_ + "/policy/program", std::ios::binary) << program;
  fs::permissions(root_ + "/policy/program", fs::perms(0755));
  for (const char* command : {"./program", "./run"}) {
    order.command = {command};
    const Outcomes outcomes = Play(order);
    ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
    const FaultEvidence& fault = outcomes.episodes[0].fault;
    EXPECT_EQ(fault.outcome, Outcome::kCrash) << fault.detail;
    EXPECT_THAT(fault.detail, HasSubstr("./program: error while loading shared libraries"));
    EXPECT_THAT(
        fault.detail,
        HasSubstr("the sandbox does not have libq.so.6: put it into the submission, and its "
                  "folder (as /policy/lib) into LD_LIBRARY_PATH"));
  }
}

TEST_F(RunnerTest, FloodOfOutputIsCutAndNotedAndSpoilsNoRecord) {
  budgets_["output_bytes"] = 65536;
  const Outcomes outcomes = Play(ScriptOrder("head -c 3000000 /dev/urandom; echo END; exit 3"));
  ASSERT_TRUE(outcomes.end.has_value());
  EXPECT_TRUE(outcomes.end->stdout_truncated);
  EXPECT_FALSE(outcomes.end->stderr_truncated);
  EXPECT_THAT(outcomes.end->stdout_tail, HasSubstr("END"));
  EXPECT_LE(outcomes.end->stdout_tail.size(), 4096u);
}

TEST_F(RunnerTest, WhatIsTooLongToStartIsThePolicysFault) {
  LeaseOrder order = ScriptOrder("exit 0");
  order.command.push_back(std::string(200'000, 'x'));
  const Outcomes outcomes = Play(order);
  ASSERT_TRUE(outcomes.end.has_value());
  EXPECT_TRUE(outcomes.end->ok) << outcomes.end->detail;
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("can be passed to a program"));
}

TEST_F(RunnerTest, SeesNothingOfTheHostAndWritesOnlyToItsScratch) {
  const LeaseOrder order = ScriptOrder(absl::StrCat(
      "echo uid $(id -u); ls /; cat /etc/shadow ", root_, "/work/order.json; touch /policy/x /x "
      "/dev/x /etc/x; echo scratch > /tmp/ok && echo wrote; ls /proc | grep -c '^[0-9]'; "
      "unshare -U true; ls -l /proc/self/fd; exit 1"));
  const Outcomes outcomes = Play(order);
  ASSERT_TRUE(outcomes.end.has_value());
  const LeaseEndRecord& end = *outcomes.end;
  EXPECT_GT(end.simulator_cpu_s, 0);
  EXPECT_THAT(end.stdout_tail, HasSubstr("uid 1000"));
  EXPECT_THAT(end.stdout_tail, HasSubstr("wrote"));
  EXPECT_THAT(end.stdout_tail, ::testing::Not(HasSubstr("policy_seed")));
  EXPECT_THAT(end.stdout_tail, ::testing::Not(HasSubstr("socket:")));
  EXPECT_THAT(end.stderr_tail, HasSubstr("cannot touch '/policy/x': Read-only"));
  EXPECT_THAT(end.stderr_tail, HasSubstr("cannot touch '/x': Read-only"));
  EXPECT_THAT(end.stderr_tail, HasSubstr("unshare failed: Operation not permitted"));
  EXPECT_FALSE(fs::exists(root_ + "/policy/x"));
}

TEST_F(RunnerTest, KillEndsEverythingWithinASecond) {
  const LeaseOrder order = ScriptOrder("trap '' TERM; setsid sleep 1000 & sleep 1000");
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
  ASSERT_TRUE(runner.ok()) << runner.status();
  absl::SleepFor(absl::Seconds(2));
  const absl::Duration start = SystemClock().Monotonic();
  (*runner)->Kill();
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(1));
  ExpectNothingLeft((*runner)->pid());
}

TEST_F(RunnerTest, NothingSurvivesTheRunnersSigkill) {
  const LeaseOrder order = ScriptOrder("setsid sleep 1000 & sleep 1000");
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
  ASSERT_TRUE(runner.ok()) << runner.status();
  absl::SleepFor(absl::Seconds(2));
  const pid_t first = (*runner)->pid();
  kill(first, SIGKILL);
  ASSERT_TRUE(EndsWithin(first, absl::Seconds(1)));
  absl::SleepFor(absl::Milliseconds(500));
  if (geteuid() == 0) {
    EXPECT_THAT(ProcessesOfSlot(), ::testing::IsEmpty());
  }
  // The next lease removes its control groups.
  const Outcomes next = Play(ScriptOrder("exit 0"));
  EXPECT_THAT(LeftGroups(first), ::testing::IsEmpty());
}

TEST_F(RunnerTest, AllThatALeaseStartsIsKnownByTheMarkOfItsSlot) {
  const SlotProcesses slots(-1, root_ + "/slots");
  LeaseOrder order = ScriptOrder("setsid sleep 1000 & sleep 2; exit 7");
  order.slot = 1;
  ASSERT_TRUE(slots.Claim(order).ok());
  std::string seen;
  meddle_ = [&](pid_t) {
    for (const auto& [slot, words] : slots.Find(0, 3)) absl::StrAppend(&seen, slot, ": ", words);
  };
  const Outcomes outcomes = Play(order);
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_THAT(outcomes.episodes[0].fault.detail, HasSubstr("status 7"));
  for (const char* name : {"myograde-runner", "myograde-sim", "myograde-bridge", "sleep"}) {
    EXPECT_THAT(seen, HasSubstr(absl::StrCat("(", name, ", state ")));
  }
  EXPECT_THAT(seen, HasSubstr("1: "));
  EXPECT_THAT(seen, ::testing::Not(::testing::AnyOf(HasSubstr("0: "), HasSubstr("2: "))));
  EXPECT_THAT(slots.Find(0, 3), ::testing::IsEmpty());
}

TEST_F(RunnerTest, BrokenOrdersAreToldInOneSentence) {
  LeaseOrder order = ScriptOrder("exit 0");
  order.cache_dir = root_ + "/nowhere";
  Outcomes outcomes = Play(order);
  EXPECT_FALSE(outcomes.end->ok);
  EXPECT_THAT(outcomes.end->detail, HasSubstr("nowhere"));
  order = ScriptOrder("exit 0");
  order.runtimes = {"/proc/self"};
  outcomes = Play(order);
  EXPECT_FALSE(outcomes.end->ok);
  EXPECT_THAT(outcomes.end->detail, HasSubstr("/proc/self"));
  order.work_dir = root_ + "/no-work";
  EXPECT_TRUE(absl::IsNotFound(RunnerProcess::Start(order).status()));
}

}  // namespace
}  // namespace myograde::server
