// The memory file that a simulator writes a trajectory to.
#include "server/runner/log_keeper.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "protocol/lease/sim_channel.h"

namespace myograde::server {
namespace {

class TrajectoryFileTest : public testing::Test {
 protected:
  ~TrajectoryFileTest() override { unlink(path_.c_str()); }
  const std::string path_ = testing::TempDir() + "/trajectory-" + std::to_string(getpid());
};

TEST_F(TrajectoryFileTest, KeepsWhatWasWritten) {
  absl::StatusOr<TrajectoryFile> file = TrajectoryFile::Make(path_);
  ASSERT_TRUE(file.ok()) << file.status();
  std::string bytes;
  for (int i = 0; i < 1'000'000; ++i) bytes.push_back(static_cast<char>(i % 253));
  ASSERT_TRUE(WriteAll(file->memory(), bytes).ok());
  ASSERT_TRUE(file->Keep(std::ssize(bytes)).ok());
  EXPECT_EQ(*ReadFile(path_), bytes);
}

TEST_F(TrajectoryFileTest, CantGrow) {
  absl::StatusOr<TrajectoryFile> file = TrajectoryFile::Make(path_);
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_NE(ftruncate(file->memory(), kMostTrajectoryFileBytes + 1), 0);
  EXPECT_LT(pwrite(file->memory(), "x", 1, kMostTrajectoryFileBytes), 0);
  for (const int64_t bytes : {int64_t{0}, int64_t{-1}, kMostTrajectoryFileBytes + 1, INT64_MAX}) {
    EXPECT_FALSE(file->Keep(bytes).ok()) << bytes;
  }
  EXPECT_FALSE(TrajectoryFile::Make(path_).ok()) << "one that is there already is nobody's";
}

}  // namespace
}  // namespace myograde::server
