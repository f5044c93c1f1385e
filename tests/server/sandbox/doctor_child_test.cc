// The child processes in which the doctor runs its trials.
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <string>

#include <absl/time/clock.h>
#include <gtest/gtest.h>

#include "protocol/base/clock.h"
#include "server/sandbox/doctor_host.h"

namespace myograde::server {
namespace {

ChildEnd RunScript(const char* script, absl::Duration timeout) {
  return RunInChild([&] { return execl("/bin/sh", "sh", "-c", script, nullptr); }, timeout);
}

TEST(Child, GivesExitCodeAndOutput) {
  const ChildEnd end = RunInChild(
      [] {
        dprintf(STDOUT_FILENO, "out\n");
        dprintf(STDERR_FILENO, "err\n");
        return 7;
      },
      absl::Seconds(10));
  EXPECT_TRUE(end.in_time);
  EXPECT_EQ(end.exit_code, 7);
  EXPECT_EQ(end.output, "out\nerr\n");
}

TEST(Child, IsKilledAtItsDeadlineWithAllThatItStarted) {
  const absl::Duration start = SystemClock().Monotonic();
  const ChildEnd end = RunScript("sleep 60 & echo $!; wait", absl::Milliseconds(300));
  EXPECT_FALSE(end.in_time);
  EXPECT_EQ(end.exit_code, -1);
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(20));
  const pid_t sleeper = static_cast<pid_t>(std::stol(end.output));
  // It dies at once, but its new parent may take a moment to reap it.
  const auto state = [sleeper] {
    char path[64];
    std::snprintf(path, sizeof(path), "/proc/%d/stat", sleeper);
    FILE* file = std::fopen(path, "r");
    char letter = 'X';
    if (file != nullptr) {
      if (std::fscanf(file, "%*d %*s %c", &letter) != 1) letter = 'X';
      std::fclose(file);
    }
    return letter;
  };
  for (int i = 0; i < 200 && state() != 'X' && state() != 'Z'; ++i) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_TRUE(state() == 'X' || state() == 'Z') << state();
}

TEST(Child, ThatLeavesSomebodyWithItsPipeDoesNotHoldUsUp) {
  const absl::Duration start = SystemClock().Monotonic();
  const ChildEnd end = RunScript("sleep 60 & exit 3", absl::Seconds(30));
  EXPECT_EQ(end.exit_code, 3);
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(20));
}

TEST(Child, KeepsABoundedPartOfAFlood) {
  const ChildEnd end = RunScript("head -c 3000000 /dev/zero", absl::Seconds(30));
  EXPECT_EQ(end.exit_code, 0);
  EXPECT_EQ(end.output.size(), size_t{1} << 20);
}

TEST(Child, TellsSignals) {
  EXPECT_EQ(RunInChild([] { return raise(SIGKILL); }, absl::Seconds(10)).exit_code,
            128 + SIGKILL);
}

TEST(LastWords, AreTheLastLinesWithoutControlCharacters) {
  EXPECT_EQ(LastWords(""), "");
  EXPECT_EQ(LastWords("\n\n"), "");
  EXPECT_EQ(LastWords("one\ntwo\r\n\n"), "one; two");
  EXPECT_EQ(LastWords("one\n\ntwo\nthree"), "two; three");
  EXPECT_EQ(LastWords("one"), "one");
  EXPECT_EQ(LastWords("a\x1b[2J"), "a?[2J");
}

}  // namespace
}  // namespace myograde::server
