// A temporary folder goes with whoever made it, however that one ends.
#include "server/base/temp_folder.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <absl/time/clock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

TEST(TempFolder, GoesAtTheEndOfItsLife) {
  std::string path;
  {
    absl::StatusOr<TempFolder> made = TempFolder::Make("test");
    ASSERT_TRUE(made.ok()) << made.status();
    const TempFolder folder = *std::move(made);
    path = folder.path();
    std::ofstream(path + "/file") << "x";
    EXPECT_TRUE(fs::exists(path));
  }
  EXPECT_FALSE(fs::exists(path));
}

TEST(TempFolder, GoesWhenASignalEndsItsMaker) {
  for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGKILL}) {
    int told[2];
    ASSERT_EQ(pipe(told), 0);
    const pid_t child = fork();
    if (child == 0) {
      setpgid(0, 0);
      const absl::StatusOr<TempFolder> folder = TempFolder::Make("test");
      if (!folder.ok()) _exit(1);
      std::ofstream(folder->path() + "/file") << "x";
      (void)!write(told[1], folder->path().data(), folder->path().size());
      while (true) pause();
    }
    char name[4096] = {};
    ASSERT_GT(read(told[0], name, sizeof(name) - 1), 0);
    EXPECT_TRUE(fs::exists(name));
    while (kill(-child, signal) != 0) absl::SleepFor(absl::Milliseconds(1));
    waitpid(child, nullptr, 0);
    for (int i = 0; i < 1000 && fs::exists(name); ++i) absl::SleepFor(absl::Milliseconds(10));
    EXPECT_FALSE(fs::exists(name)) << "signal " << signal;
    close(told[0]);
    close(told[1]);
  }
}

}  // namespace
}  // namespace myograde::server
