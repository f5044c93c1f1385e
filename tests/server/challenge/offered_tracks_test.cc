// Tracks as they are loaded: what practice plays.
#include "server/challenge/offered_tracks.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using testing::ElementsAre;

class TracksTest : public testing::Test {
 protected:
  TracksTest() {
    std::filesystem::remove_all(dir_);
    std::filesystem::create_directory(dir_);
    for (const char* name : {"manipulation", "elbow"}) {
      std::filesystem::copy(std::string(MYOGRADE_SOURCE_DIR "/configs/tracks/") + name + ".json",
                            dir_);
    }
  }
  ~TracksTest() override { std::filesystem::remove_all(dir_); }

  void Write(const std::string& name, const std::string& text) {
    std::ofstream(dir_ + "/" + name + ".json") << text;
  }
  std::vector<uint64_t> PracticeOf(const std::string& track) {
    const auto tracks = Tracks::Load(dir_);
    EXPECT_TRUE(tracks.ok()) << tracks.status();
    return tracks.ok() ? (*tracks->Find(track, ""))->config.practice_seeds
                       : std::vector<uint64_t>();
  }

  const std::string dir_ = testing::TempDir() + "/tracks_" +
                           testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(TracksTest, PracticeBeginsAfterWhatTheEnvironmentRanks) {
  Write("one", R"({"extends": "manipulation", "seeds": [5, 700]})");
  Write("two", R"({"extends": "elbow", "seeds": [5, 9000]})");
  EXPECT_THAT(PracticeOf("one"), ElementsAre(701, 702));
}

TEST_F(TracksTest, NamedPracticeSeedsGiveWayToOthersThatAreRanked) {
  EXPECT_EQ(PracticeOf("manipulation").front(), 100u);
  Write("one", R"({"extends": "manipulation", "seeds": {"first": 100, "count": 99}})");
  const std::vector<uint64_t> seeds = PracticeOf("manipulation");
  EXPECT_EQ(seeds.size(), 100u);
  EXPECT_EQ(seeds[0], 199u) << "the one that nobody else ranks";
  EXPECT_EQ(seeds[1], 200u);
}

TEST_F(TracksTest, RankedSeedsAreKnownByEnvironment) {
  Write("one", R"({"extends": "manipulation", "seeds": [700]})");
  const auto tracks = Tracks::Load(dir_);
  ASSERT_TRUE(tracks.ok()) << tracks.status();
  const TrackKind& arm = *(*tracks->Find("manipulation", ""))->config.kind;
  const TrackKind& elbow = *(*tracks->Find("elbow", ""))->config.kind;
  EXPECT_EQ(tracks->RankedBy(arm, 700), "one");
  EXPECT_EQ(tracks->RankedBy(arm, 99), "manipulation");
  EXPECT_EQ(tracks->RankedBy(elbow, 700), "");
  EXPECT_EQ(tracks->RankedBy(arm, 701), "");
}

}  // namespace
}  // namespace myograde::server
