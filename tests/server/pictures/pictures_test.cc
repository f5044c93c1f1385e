// The queue of pictures and the folder that they are kept in, without simulator and store.
#include "server/pictures/pictures.h"

#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "server/base/child_process.h"
#include "server/pictures/packing.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Is = PictureState::Is;

constexpr int64_t kRoomy = 1 << 20;

PictureKey Trajectory(const std::string& log) { return {PictureKind::kTrajectory, log}; }

class PicturesTest : public testing::Test {
 protected:
  PicturesTest() {
    std::string path = testing::TempDir() + "/pictures-XXXXXX";
    folder_ = mkdtemp(path.data());
  }
  ~PicturesTest() override {
    go_ = true;
    pictures_.reset();
    std::filesystem::remove_all(folder_);
  }

  PicturesOptions Options() {
    return {.folder = folder_,
            .build = [] { return std::string("0123456789abcdef"); },
            .most_bytes = most_bytes_,
            .make = [this](const PictureKey& key, const Stopped& stopped) { return Make(key, stopped); },
            .grading = [this] { return grading_.load(); },
            .quiet = quiet_,
            .suggestions =
                [this] {
                  const MutexLock lock(mutex_);
                  return std::exchange(suggested_, {});
                }};
  }

  Pictures& Start() {
    pictures_ = std::make_unique<Pictures>(Options());
    return *pictures_;
  }

  // Waits for go_, unless it is stopped.
  absl::StatusOr<std::string> Make(const PictureKey& key, const Stopped& stopped) {
    ++begun_;
    while (!go_) {
      if (stopped()) {
        ++stopped_;
        return absl::CancelledError("stopped");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const MutexLock lock(mutex_);
    made_.push_back(key.of);
    if (key.of.starts_with("bad")) return absl::DataLossError("the log is damaged");
    if (key.of.starts_with("gone")) return absl::NotFoundError("no log");
    if (key.of.starts_with("trouble")) return absl::InternalError("/secret/path is full");
    return "content of " + key.of;
  }

  std::vector<std::string> made() {
    const MutexLock lock(mutex_);
    return made_;
  }

  void WaitUntil(const std::function<bool()>& fits) {
    for (int i = 0; i < 10'000 && !fits(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_TRUE(fits());
  }

  // Of what was asked for: until it is there, or failed.
  void AwaitEnd(const PictureKey& key) {
    WaitUntil([&] {
      const Is is = pictures_->Ask(key, "uid 9").is;
      return is != Is::kWaiting && is != Is::kPlaying;
    });
  }

  std::string folder_;
  int64_t most_bytes_ = kRoomy;
  absl::Duration quiet_ = absl::ZeroDuration();
  std::atomic<bool> go_ = true;
  std::atomic<bool> grading_ = false;
  std::atomic<int> begun_ = 0;
  std::atomic<int> stopped_ = 0;
  Mutex mutex_;
  std::vector<PictureKey> suggested_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::string> made_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<Pictures> pictures_;
};

TEST_F(PicturesTest, WhatIsAskedForIsMadeOnceAndKept) {
  Pictures& pictures = Start();
  EXPECT_EQ(pictures.Ask(Trajectory("a"), "uid 1").is, Is::kWaiting);
  AwaitEnd(Trajectory("a"));
  EXPECT_EQ(pictures.Ask(Trajectory("a"), "uid 2").is, Is::kReady);
  EXPECT_THAT(made(), ElementsAre("a"));
  const auto found = pictures.files().Find(Trajectory("a"), Packing::kZstd);
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(*UnpackZstd(*ReadFile(found->path), 1000), "content of a");
  EXPECT_EQ(found->tag, "\"a-0123456789abcdef.zst\"");
  // Of another build of the grader it is made again.
  const PictureFiles other(folder_, [] { return std::string("fedcba9876543210"); }, kRoomy);
  EXPECT_FALSE(other.Has(Trajectory("a")));
}

TEST_F(PicturesTest, TellsPlacesAndKeepsTheOrder) {
  go_ = false;
  Pictures& pictures = Start();
  pictures.Ask(Trajectory("a"), "uid 1");
  WaitUntil([&] { return begun_ == 1; });
  EXPECT_EQ(pictures.Ask(Trajectory("a"), "uid 2").is, Is::kPlaying);
  EXPECT_EQ(pictures.Ask(Trajectory("b"), "uid 1").place, 1);
  EXPECT_EQ(pictures.Ask(Trajectory("c"), "uid 1").place, 2);
  EXPECT_EQ(pictures.Ask(Trajectory("b"), "uid 9").place, 1) << "asking again changes nothing";
  go_ = true;
  AwaitEnd(Trajectory("c"));
  EXPECT_THAT(made(), ElementsAre("a", "b", "c"));
}

TEST_F(PicturesTest, NobodyFillsTheQueue) {
  go_ = false;
  Pictures& pictures = Start();
  pictures.Ask(Trajectory("first"), "uid 1");
  WaitUntil([&] { return begun_ == 1; });
  for (size_t i = 0; i < Pictures::kMostOfOne; ++i) {
    EXPECT_EQ(pictures.Ask(Trajectory("a" + std::to_string(i)), "uid 1").is, Is::kWaiting);
  }
  EXPECT_EQ(pictures.Ask(Trajectory("more"), "uid 1").is, Is::kFull);
  EXPECT_EQ(pictures.Ask(Trajectory("others"), "uid 2").is, Is::kWaiting);
  int waiting = 0;
  for (int i = 0; i < 1000; ++i) {
    waiting += pictures.Ask(Trajectory("o" + std::to_string(i)), "").is == Is::kWaiting;
  }
  EXPECT_EQ(waiting, static_cast<int>(Pictures::kMostWaiting - Pictures::kMostOfOne - 1));
}

TEST_F(PicturesTest, FailuresAreToldAndNotRepeatedForEver) {
  Pictures& pictures = Start();
  for (const char* log : {"bad", "gone", "trouble"}) pictures.Ask(Trajectory(log), "uid 1");
  AwaitEnd(Trajectory("trouble"));
  for (int i = 0; i < 3; ++i) {
    const PictureState bad = pictures.Ask(Trajectory("bad"), "uid 1");
    EXPECT_EQ(bad.is, Is::kFailed);
    EXPECT_EQ(bad.why, "the log is damaged");
    EXPECT_EQ(pictures.Ask(Trajectory("gone"), "uid 1").is, Is::kMissing);
    const PictureState trouble = pictures.Ask(Trajectory("trouble"), "uid 1");
    EXPECT_EQ(trouble.is, Is::kFailed);
    EXPECT_THAT(trouble.why, testing::Not(HasSubstr("/secret"))) << "no path for strangers";
  }
  EXPECT_EQ(made().size(), 3u);
}

TEST_F(PicturesTest, WhatNobodyAskedForNeverStandsInTheWay) {
  grading_ = true;
  go_ = false;
  {
    const MutexLock lock(mutex_);
    suggested_ = {Trajectory("s"), Trajectory("t")};
  }
  Pictures& pictures = Start();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(begun_, 0) << "not while leases run";
  grading_ = false;
  // What somebody asks for is made at any time; the thread then looks for suggestions.
  pictures.Ask(Trajectory("a"), "uid 1");
  WaitUntil([&] { return begun_ == 1; });
  go_ = true;
  AwaitEnd(Trajectory("a"));
  WaitUntil([&] { return made().size() == 3; });
  EXPECT_THAT(made(), ElementsAre("a", "s", "t"));
}

TEST_F(PicturesTest, WhatNobodyAskedForMayNeverBeMade) {
  quiet_ = absl::InfiniteDuration();
  {
    const MutexLock lock(mutex_);
    suggested_ = {Trajectory("s")};
  }
  Pictures& pictures = Start();
  pictures.Ask(Trajectory("a"), "uid 1");
  AwaitEnd(Trajectory("a"));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_THAT(made(), ElementsAre("a"));
}

TEST_F(PicturesTest, ASuggestionGivesWayToGradingAndToPeople) {
  go_ = false;
  {
    const MutexLock lock(mutex_);
    suggested_ = {Trajectory("s"), Trajectory("t")};
  }
  Pictures& pictures = Start();
  WaitUntil([&] { return begun_ == 1; });
  grading_ = true;
  WaitUntil([&] { return stopped_ == 1; });
  grading_ = false;
  EXPECT_EQ(pictures.Ask(Trajectory("a"), "uid 1").is, Is::kWaiting);
  WaitUntil([&] { return begun_ >= 2; });
  go_ = true;
  AwaitEnd(Trajectory("a"));
  EXPECT_THAT(made(), testing::Contains("a"));
}

TEST_F(PicturesTest, AStopEndsWhatIsBeingMade) {
  go_ = false;
  Pictures& pictures = Start();
  pictures.Ask(Trajectory("a"), "uid 1");
  WaitUntil([&] { return begun_ == 1; });
  pictures.Stop();
  pictures_.reset();
  EXPECT_EQ(stopped_, 1);
  EXPECT_THAT(made(), IsEmpty());
}

TEST_F(PicturesTest, TheFolderStaysWithinItsSize) {
  const PictureFiles files(folder_, [] { return std::string("b"); }, 10'000);
  const auto key = [](const std::string& of) { return PictureKey{PictureKind::kPicture, of}; };
  for (const char* of : {"a", "b", "c"}) {
    ASSERT_TRUE(files.Keep(key(of), std::string(3'000, *of)).ok());
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(files.Has(key("a"))) << "used again, and so the last to go";
  std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ASSERT_TRUE(files.Keep(key("d"), std::string(3'000, 'd')).ok());
  EXPECT_TRUE(files.Has(key("a")));
  EXPECT_FALSE(files.Has(key("b")));
  EXPECT_TRUE(files.Has(key("d")));
}

TEST_F(PicturesTest, DraftsOfADaemonThatDiedAreRemoved) {
  std::ofstream(folder_ + "/x-b.png.draft") << "half";
  const PictureFiles files(folder_, [] { return std::string("b"); }, kRoomy);
  files.RemoveDrafts();
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
  // A folder that can't be written is an error, and not a file that is empty.
  const PictureFiles none(folder_ + "/none", [] { return std::string("b"); }, kRoomy);
  EXPECT_THAT(std::string(none.Keep(Trajectory("a"), "content").message()), HasSubstr("none/"));
  EXPECT_FALSE(none.Has(Trajectory("a")));
}

TEST(Packing, GivesTheSameBytesBack) {
  std::string text;
  for (int i = 0; i < 100'000; ++i) text += static_cast<char>(i % 251 * i % 249);
  EXPECT_EQ(*UnpackZstd(CompressZstd(text), text.size()), text);
  EXPECT_FALSE(UnpackZstd(CompressZstd(text), text.size() - 1).ok());
  EXPECT_FALSE(UnpackZstd("nonsense", 1000).ok());
  EXPECT_FALSE(UnpackZstd(CompressZstd(text).substr(0, 50), text.size()).ok());
  const std::string packed = CompressGzip(text);
  z_stream stream = {};
  ASSERT_EQ(inflateInit2(&stream, 15 + 16), Z_OK);
  std::string back(text.size() + 1, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(back.data());
  stream.avail_out = static_cast<uInt>(back.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  back.resize(stream.total_out);
  inflateEnd(&stream);
  EXPECT_EQ(back, text);
}

// A folder with a program of the test's own.
class ProgramRuns : public PicturesTest {
 protected:
  ProgramRuns() {
    const char* before = getenv("MYOGRADE_BIN_DIR");
    if (before != nullptr) before_ = before;
    setenv("MYOGRADE_BIN_DIR", folder_.c_str(), 1);
  }
  ~ProgramRuns() override {
    if (before_.empty()) {
      unsetenv("MYOGRADE_BIN_DIR");
    } else {
      setenv("MYOGRADE_BIN_DIR", before_.c_str(), 1);
    }
  }

  absl::StatusOr<ProgramEnd> Run(const std::string& script, const ProgramOrder& order,
                                 const std::function<bool()>& stopped = [] { return false; }) {
    const std::string path = folder_ + "/program";
    std::ofstream(path) << "#!/bin/sh\n" << script << "\n";
    chmod(path.c_str(), 0755);
    ProgramOrder full = order;
    full.program = "program";
    return RunProgram(full, stopped);
  }

  std::string before_;
};

TEST_F(ProgramRuns, TakeTextAndGiveBytes) {
  const auto end = Run("cat; echo no good >&2; exit 3",
                       {.program = "", .words = {}, .input = "text", .most_output = 4});
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->output, "text");
  EXPECT_EQ(end->exit_status, 3);
  EXPECT_EQ(end->LastError(), "no good");
  EXPECT_EQ(end->HowItEnded(), "exited with status 3");
}

TEST_F(ProgramRuns, AreBounded) {
  EXPECT_TRUE(absl::IsResourceExhausted(
      Run("yes", {.program = "", .words = {}, .input = "", .most_output = 1000}).status()));
  EXPECT_TRUE(absl::IsDeadlineExceeded(
      Run("sleep 60", {.program = "", .words = {}, .input = "", .most_output = 0,
                       .deadline = absl::Milliseconds(200)}).status()));
  EXPECT_TRUE(absl::IsCancelled(Run("sleep 60", {}, [] { return true; }).status()));
  EXPECT_TRUE(absl::IsInternal(RunProgram({.program = "missing"}, [] { return false; }).status()));
}

}  // namespace
}  // namespace myograde::server
