#include "protocol/base/spawn.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <optional>
#include <string>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;

// The standard output of a shell command line.
std::string Printed(const std::string& line, SpawnOrder order = {}) {
  absl::StatusOr<Pipe> pipe = MakePipe();
  if (!pipe.ok()) return std::string(pipe.status().message());
  order.program = "/bin/sh";
  order.words = {"shell", "-c", line};
  order.out = pipe->write.get();
  const absl::StatusOr<pid_t> pid = Spawn(order);
  if (!pid.ok()) return std::string(pid.status().message());
  pipe->write.reset();
  const absl::StatusOr<std::string> text = ReadAll(pipe->read.get(), "the pipe");
  EXPECT_EQ(waitpid(*pid, nullptr, 0), *pid);
  return text.ok() ? *text : std::string(text.status().message());
}

pid_t Sleeper() {
  const absl::StatusOr<pid_t> pid = Spawn({"/bin/sleep", {"sleep", "60"}});
  EXPECT_TRUE(pid.ok()) << pid.status();
  return *pid;
}

TEST(MakePipe, LeavesTheStandardStreamsAlone) {
  const Fd saved(fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3));
  ASSERT_TRUE(saved.valid());
  close(STDIN_FILENO);
  const absl::StatusOr<Pipe> pipe = MakePipe();
  dup2(saved.get(), STDIN_FILENO);
  ASSERT_TRUE(pipe.ok()) << pipe.status();
  for (const Fd* end : {&pipe->read, &pipe->write}) {
    EXPECT_GT(end->get(), STDERR_FILENO);
    EXPECT_EQ(fcntl(end->get(), F_GETFD), FD_CLOEXEC);
  }
}

TEST(MakeOutputPipe, ItsReaderNeverWaits) {
  const absl::StatusOr<Pipe> pipe = MakeOutputPipe();
  ASSERT_TRUE(pipe.ok()) << pipe.status();
  char byte;
  EXPECT_EQ(read(pipe->read.get(), &byte, 1), -1);
  EXPECT_EQ(errno, EAGAIN);
  EXPECT_EQ(fcntl(pipe->write.get(), F_GETFL) & O_NONBLOCK, 0);
}

TEST(Spawn, GivesStreamsWordsAndNothingElse) {
  const Fd leak(open("/dev/null", O_RDONLY));  // without O_CLOEXEC
  EXPECT_EQ(Printed("echo $0; cat; ls /proc/$$/fd"), "shell\n0\n1\n2\n");
}

TEST(Spawn, TakesItsInputAndErrorsFromItsOrder) {
  absl::StatusOr<Pipe> in = MakePipe();
  absl::StatusOr<Pipe> err = MakePipe();
  ASSERT_TRUE(in.ok() && err.ok());
  ASSERT_TRUE(WriteAll(in->write.get(), "said").ok());
  in->write.reset();
  SpawnOrder order;
  order.in = in->read.get();
  order.err = err->write.get();
  EXPECT_EQ(Printed("cat; echo complained >&2", order), "said");
  err->write.reset();
  EXPECT_EQ(ReadAll(err->read.get(), "the pipe").value_or(""), "complained\n");
}

TEST(Spawn, LeadsAGroupWithSignalsAsAtTheBeginning) {
  sigset_t blocked, before;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGTERM);
  ASSERT_EQ(sigprocmask(SIG_BLOCK, &blocked, &before), 0);
  const auto handler = std::signal(SIGPIPE, SIG_IGN);
  const std::string shown = Printed("exec grep -E 'Sig(Blk|Ign)' /proc/self/status");
  std::signal(SIGPIPE, handler);
  sigprocmask(SIG_SETMASK, &before, nullptr);
  EXPECT_THAT(shown, HasSubstr("SigBlk:\t0000000000000000\n"));
  const unsigned long ignored = std::stoul(shown.substr(shown.find("SigIgn:") + 7), nullptr, 16);
  EXPECT_EQ(ignored & (1UL << (SIGPIPE - 1)), 0U) << shown;
  EXPECT_EQ(Printed("[ $(cut -d' ' -f5 /proc/$$/stat) = $$ ] && echo leads"), "leads\n");
}

TEST(Spawn, IsAsNiceAsItsOrder) {
  errno = 0;
  const int own = getpriority(PRIO_PROCESS, 0);
  ASSERT_EQ(errno, 0);
  if (own > 15) GTEST_SKIP() << "this process is too nice already";
  SpawnOrder order;
  order.nice = std::max(own, 0) + 3;  // 0 would leave it as it is
  // The value is reported once the program runs.
  const std::string nice = std::to_string(order.nice);
  EXPECT_EQ(Printed("while [ $(nice) != " + nice + " ]; do sleep 0.01; done; nice", order),
            nice + "\n");
}

TEST(Spawn, WhatCantBeExecutedIsAnError) {
  const absl::Status status = Spawn({"/nowhere/program", {"program"}}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_EQ(status.message(), "can't start /nowhere/program: No such file or directory");
}

TEST(EndsWithin, SeesTheEndAndLeavesItToBeReaped) {
  const pid_t pid = Sleeper();
  const absl::Duration start = SystemClock().Monotonic();
  EXPECT_FALSE(EndsWithin(pid, absl::Milliseconds(50)));
  EXPECT_GE(SystemClock().Monotonic() - start, absl::Milliseconds(50));
  kill(pid, SIGKILL);
  EXPECT_TRUE(EndsWithin(pid, absl::Seconds(20)));
  EXPECT_TRUE(EndsWithin(pid, absl::ZeroDuration()));
  int status = 0;
  ASSERT_EQ(waitpid(pid, &status, 0), pid);
  EXPECT_TRUE(WIFSIGNALED(status));
}

TEST(EndsWithin, WorksWhereNoDescriptorIsLeft) {
  const pid_t pid = Sleeper();
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none = {0, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const bool early = EndsWithin(pid, absl::Milliseconds(30));
  kill(pid, SIGKILL);
  const bool ended = EndsWithin(pid, absl::Seconds(20));
  setrlimit(RLIMIT_NOFILE, &before);
  EXPECT_FALSE(early);
  EXPECT_TRUE(ended);
  EXPECT_EQ(waitpid(pid, nullptr, 0), pid);
}

}  // namespace
}  // namespace myograde
