// What practice plays: never a ranked seed, and no part of a config's hash.
#include "protocol/lease/practice_seeds.h"

#include <filesystem>
#include <fstream>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/lease/track_config.h"

namespace myograde {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr uint64_t kLargest = INT64_MAX;
const char kShippedFolder[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

TEST(DefaultPracticeSeeds, BeginAfterTheLargestRankedOne) {
  EXPECT_THAT(DefaultPracticeSeeds({3, 0, 7}, 3), ElementsAre(8, 9, 10));
  EXPECT_THAT(DefaultPracticeSeeds({}, 2), ElementsAre(0, 1));
}

TEST(DefaultPracticeSeeds, GoOnWithTheSmallestFreeOnesAtTheEndOfTheRange) {
  EXPECT_THAT(DefaultPracticeSeeds({0, 2, kLargest - 1}, 4), ElementsAre(kLargest, 1, 3, 4));
  EXPECT_THAT(DefaultPracticeSeeds({0, kLargest}, 2), ElementsAre(1, 2));
}

TEST(DefaultPracticeSeeds, AreDistinctValidAndNeverRanked) {
  EXPECT_TRUE(rc::check([](std::set<uint64_t> ranked) {
    for (const uint64_t near : {uint64_t{0}, uint64_t{1}}) {
      if (*rc::gen::arbitrary<bool>()) ranked.insert(kLargest - near);
    }
    std::erase_if(ranked, [](uint64_t seed) { return seed > kLargest; });
    const auto count = *rc::gen::inRange<int64_t>(1, 50);
    const std::vector<uint64_t> seeds = DefaultPracticeSeeds(ranked, count);
    RC_ASSERT(std::ssize(seeds) == count);
    RC_ASSERT(std::set<uint64_t>(seeds.begin(), seeds.end()).size() == seeds.size());
    for (const uint64_t seed : seeds) RC_ASSERT(seed <= kLargest && !ranked.contains(seed));
  }));
}

class PracticeFiles : public testing::Test {
 protected:
  PracticeFiles() {
    std::filesystem::remove_all(dir_);
    std::filesystem::create_directory(dir_);
    std::filesystem::copy(std::string(kShippedFolder) + "/manipulation.json", dir_);
  }
  ~PracticeFiles() override { std::filesystem::remove_all(dir_); }

  absl::StatusOr<TrackConfig> Load(const std::string& text) {
    std::ofstream(dir_ + "/own.json") << text;
    return LoadTrackConfig(dir_, "own", "");
  }

  const std::string dir_ = testing::TempDir() + "/practice_files_" +
                           testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(PracticeFiles, AreNoPartOfTheConfigAndItsHash) {
  const auto without = Load(R"({"extends": "manipulation", "seeds": [5, 7]})");
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_THAT(without->practice_seeds, IsEmpty());
  const auto with = Load(R"({"extends": "manipulation", "seeds": [5, 7], "practice_seeds": [9]})");
  ASSERT_TRUE(with.ok()) << with.status();
  EXPECT_THAT(with->practice_seeds, ElementsAre(9));
  EXPECT_EQ(with->effective, without->effective);
  EXPECT_EQ(with->hash, without->hash);
}

TEST_F(PracticeFiles, BelongToTheSeedsBesideThem) {
  EXPECT_EQ(Load(R"({"extends": "manipulation"})")->practice_seeds.size(), 100u);
  EXPECT_THAT(Load(R"({"extends": "manipulation", "practice_seeds": null})")->practice_seeds,
              IsEmpty());
  const auto profile =
      Load(R"({"extends": "manipulation", "profiles": {"paper": {"seeds": [100]}}})");
  ASSERT_TRUE(profile.ok()) << profile.status();
  EXPECT_THAT(profile->practice_seeds, IsEmpty());
  EXPECT_THAT(Load(R"({"extends": "manipulation",
                       "profiles": {"paper": {"practice_seeds": [200]}}})")->practice_seeds,
              ElementsAre(200));
}

TEST_F(PracticeFiles, ARankedSeedOrABadListIsToldWithItsPlace) {
  const auto error = [&](const char* practice) {
    return std::string(Load(absl::StrCat(R"({"extends": "manipulation", "seeds": [5, 7],
                                             "practice_seeds": )", practice, "}"))
                           .status().message());
  };
  EXPECT_THAT(error("[9, 7]"), HasSubstr("own.json (profile paper): \"practice_seeds\" has the "
                                         "seed 7, which \"seeds\" has too"));
  EXPECT_THAT(error("[]"), HasSubstr("practice_seeds: has 0 seeds, must have 1 to 10000"));
  EXPECT_THAT(error("[1, 1]"), HasSubstr("practice_seeds: the seed 1 appears twice"));
  EXPECT_THAT(error("9"), HasSubstr("practice_seeds: must be"));
}

// Boards stay: the hashes are those of the release before practice had seeds of its own.
TEST(ShippedPractice, LeavesTheHashesAsTheyWere) {
  const std::pair<const char*, const char*> hashes[] = {
      {"elbow", "896dc3a886140182d1dfbc841da7572865103d5cd38e90a5ed2e48061ce0bc6b"},
      {"locomotion", "5dbd5918df262e180be004b7a5f8bad297afa507e4c404e8a5ebae7130dd13dc"},
      {"manipulation", "1e5c374da14d5ea1369d051c8ad701a0407f2b0fcd27dc005e17d1c765dbdf02"},
      {"demo-locomotion", "19611d15666dadec2f17f76fb9252ca6389b788c3ee47b680e9ddd11556fdf30"},
      {"demo-manipulation", "1a8ebf17cc0863496492c3bcf0a761a0fadef3f8b84717e4109839ba23781343"}};
  for (const auto& [track, hash] : hashes) {
    const auto config = LoadTrackConfig(kShippedFolder, track, "");
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->hash, hash) << track;
    EXPECT_EQ(config->practice_seeds.front(), 100u) << track;
    EXPECT_EQ(config->practice_seeds.size(), config->seeds.size()) << track;
  }
}

}  // namespace
}  // namespace myograde
