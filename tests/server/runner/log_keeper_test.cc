// Logs that arrive back to back, in pieces, too long and too short.
#include "server/runner/log_keeper.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <absl/status/status.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

class LogKeeperTest : public testing::Test {
 protected:
  LogKeeperTest() {
    std::string name = (fs::temp_directory_path() / "log_keeper_test.XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~LogKeeperTest() override { fs::remove_all(folder_); }

  LogKeeper Open(int64_t budget = 1 << 20) {
    auto keeper = LogKeeper::Open(folder_, "1-1", budget);
    EXPECT_TRUE(keeper.ok()) << keeper.status();
    return *std::move(keeper);
  }

  static EpisodeLogInfo Info(char digit, size_t bytes) {
    EpisodeLogInfo info;
    info.sha256 = std::string(64, digit);
    info.packed_bytes = static_cast<int64_t>(bytes);
    return info;
  }

  static void Send(const LogKeeper& keeper, const std::string& bytes) {
    ASSERT_EQ(write(keeper.writer(), bytes.data(), bytes.size()),
              static_cast<ssize_t>(bytes.size()));
  }

  std::string Kept(char digit) const {
    std::ifstream file(fs::path(folder_) / LogFileName(std::string(64, digit)), std::ios::binary);
    EXPECT_TRUE(file.good()) << digit;
    return {std::istreambuf_iterator<char>(file), {}};
  }

  std::string folder_;
};

TEST_F(LogKeeperTest, LogsThatAreTakenTogetherBecomeFilesOfTheirOwn) {
  LogKeeper keeper = Open();
  Send(keeper, "first" "second log" "thi");
  ASSERT_TRUE(keeper.Drain().ok());
  ASSERT_EQ(keeper.Finish(Info('a', 5)), absl::OkStatus());
  ASSERT_EQ(keeper.Finish(Info('b', 10)), absl::OkStatus());
  Send(keeper, "rd");
  ASSERT_EQ(keeper.Finish(Info('c', 5)), absl::OkStatus());
  EXPECT_EQ(Kept('a'), "first");
  EXPECT_EQ(Kept('b'), "second log");
  EXPECT_EQ(Kept('c'), "third");
}

TEST_F(LogKeeperTest, TakesNoMoreThanTheLogThatItFinishes) {
  LogKeeper keeper = Open();
  Send(keeper, "onetwo");
  ASSERT_EQ(keeper.Finish(Info('a', 3)), absl::OkStatus());
  ASSERT_EQ(keeper.Finish(Info('b', 3)), absl::OkStatus());
  EXPECT_EQ(Kept('a'), "one");
  EXPECT_EQ(Kept('b'), "two");
}

TEST_F(LogKeeperTest, ALongLogComesInPieces) {
  LogKeeper keeper = Open();
  std::string all;
  for (char piece = 'a'; piece < 'k'; ++piece) {
    const std::string bytes(40'000, piece);
    Send(keeper, bytes);
    ASSERT_TRUE(keeper.Drain().ok());
    all += bytes;
  }
  Send(keeper, "next");
  ASSERT_EQ(keeper.Finish(Info('a', all.size())), absl::OkStatus());
  ASSERT_EQ(keeper.Finish(Info('b', 4)), absl::OkStatus());
  EXPECT_EQ(Kept('a'), all);
  EXPECT_EQ(Kept('b'), "next");
}

TEST_F(LogKeeperTest, RefusesALogThatIsShorterThanTold) {
  LogKeeper keeper = Open();
  Send(keeper, "short");
  const absl::Status status = keeper.Finish(Info('a', 6));
  EXPECT_TRUE(absl::IsInternal(status)) << status;
  EXPECT_FALSE(fs::exists(fs::path(folder_) / LogFileName(std::string(64, 'a'))));
}

TEST_F(LogKeeperTest, RefusesALogBeyondItsBudget) {
  LogKeeper keeper = Open(/*budget=*/100);
  EXPECT_TRUE(absl::IsInternal(keeper.Finish(Info('a', 101))));
  absl::Status status;
  for (int i = 0; i < 3 && status.ok(); ++i) {
    Send(keeper, std::string(40'000, 'x'));
    status = keeper.Drain();
  }
  EXPECT_TRUE(absl::IsInternal(status)) << status;
}

TEST_F(LogKeeperTest, LeavesNoDraftBehind) {
  {
    LogKeeper keeper = Open();
    Send(keeper, "whole" "begun");
    ASSERT_TRUE(keeper.Drain().ok());
    ASSERT_EQ(keeper.Finish(Info('a', 5)), absl::OkStatus());
  }
  size_t files = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder_)) ++files;
  EXPECT_EQ(files, 1u);
}

}  // namespace
}  // namespace myograde::server
