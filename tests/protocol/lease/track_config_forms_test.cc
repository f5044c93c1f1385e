// Configs of every earlier form, as in stores, receipts and logs and as organisers wrote them: each
// keeps its hash and its meaning. forms/N holds those of form N: whole files in tracks/, each
// profile's effective config with its hash in effective.jsonl, and in meaning.json the values that
// follow from them for newer keys.
#include "protocol/lease/track_config_forms.h"

#include <filesystem>
#include <fstream>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/track_config.h"

namespace myograde {
namespace {

using nlohmann::json;
using testing::HasSubstr;
namespace fs = std::filesystem;

const char kShippedTracks[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

std::string FolderOf(int64_t form) {
  return absl::StrCat(MYOGRADE_SOURCE_DIR "/tests/protocol/lease/forms/", form);
}

struct Old {
  json config;
  std::string hash;
};

std::vector<Old> OldConfigs(int64_t form) {
  std::vector<Old> configs;
  std::ifstream file(FolderOf(form) + "/effective.jsonl");
  for (std::string line; std::getline(file, line);) {
    const json entry = json::parse(line);
    configs.push_back({entry["config"], entry["hash"]});
  }
  return configs;
}

class EarlierForms : public testing::TestWithParam<int64_t> {};

// Leaves that are in `to` but not in `from`, or differ, by path.
json Added(const json& from, const json& to) {
  json added = json::object();
  for (const json& change : json::diff(from, to)) {
    const std::string path = change["path"];
    if (change["op"] != "add") added[path] = change;
    if (change["op"] != "add") continue;
    const json& value = change["value"];
    if (!value.is_object() || value.empty()) added[path] = value;
    if (!value.is_object()) continue;
    const json leaves = value.flatten();
    for (const auto& [below, leaf] : leaves.items()) added[path + below] = leaf;
  }
  return added;
}

TEST_P(EarlierForms, KeepTheirHash) {
  const std::vector<Old> configs = OldConfigs(GetParam());
  ASSERT_GE(configs.size(), 5u) << "keep configs of form " << GetParam() << " there";
  for (const Old& old : configs) {
    const auto config = ParseTrackConfig(old.config, "test");
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->hash, old.hash);
    EXPECT_EQ(config->effective, old.config);
  }
}

TEST_P(EarlierForms, MeanWhatTheyMeant) {
  const json meaning = ReadJsonFile(FolderOf(GetParam()) + "/meaning.json").value();
  for (const Old& old : OldConfigs(GetParam())) {
    const json today = UpgradeTrackConfig(old.config, "test").value();
    const std::string track = old.config["track"], profile = old.config["profile"];
    json expected = meaning["all"];
    expected.update(meaning.at(track));
    expected.update(meaning.at(track + "/" + profile));
    EXPECT_EQ(Added(old.config, today), expected)
        << track << ", " << profile << ": say in meaning.json what form " << GetParam()
        << " meant without the key";
    const TrackConfig config = ParseTrackConfig(old.config, "test").value();
    EXPECT_EQ(config.kind->name, track);
    EXPECT_EQ(config.profile, profile);
    EXPECT_EQ(config.episodes_per_lease, old.config["episodes_per_lease"]);
    EXPECT_EQ(config.seeds.size(), old.config["seeds"]["count"]);
    const json& budgets = old.config["budgets"];
    EXPECT_EQ(config.budgets.step_s, budgets["step_s"]);
    EXPECT_EQ(config.budgets.overtime_s, budgets["overtime_s"]);
    EXPECT_EQ(config.budgets.wall_factor, budgets["wall_factor"]);
    EXPECT_EQ(config.budgets.lease_wall_s, budgets["lease_wall_s"]);
    EXPECT_EQ(config.budgets.memory_bytes, budgets["memory_bytes"]);
    EXPECT_EQ(config.budgets.restarts, budgets["restarts"]);
    const absl::StatusOr<int64_t> steps = config.kind->max_steps(config.rules);
    EXPECT_TRUE(steps.ok() && *steps > 0) << steps.status();
  }
}

// An organiser's own files, which stay as they are when a newer version is installed.
TEST_P(EarlierForms, AreReadAsFiles) {
  const std::string tracks = FolderOf(GetParam()) + "/tracks";
  for (const Old& old : OldConfigs(GetParam())) {
    const auto config = LoadTrackConfig(tracks, old.config["id"], old.config["profile"]);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->hash, old.hash);
  }
}

TEST_P(EarlierForms, MayExtendTodaysFiles) {
  const std::string dir = absl::StrCat(testing::TempDir(), "/forms-extended-", GetParam());
  fs::remove_all(dir);
  fs::create_directories(dir);
  fs::copy(absl::StrCat(kShippedTracks, "/manipulation.json"), dir);
  fs::copy(FolderOf(GetParam()) + "/tracks/demo-manipulation.json", dir);
  const auto config = LoadTrackConfig(dir, "demo-manipulation", "");
  ASSERT_TRUE(config.ok()) << config.status();
  EXPECT_EQ(config->seeds.size(), 3u);
  EXPECT_EQ(config->effective["form"], kTrackConfigForm) << "the file that it extends says it";
  fs::remove_all(dir);
}

INSTANTIATE_TEST_SUITE_P(Forms, EarlierForms, testing::Range<int64_t>(1, kTrackConfigForm));

TEST(TrackConfigForms, AChainOfFilesIsOfOneForm) {
  const std::string dir = testing::TempDir() + "/forms-mixed";
  fs::remove_all(dir);
  fs::create_directories(dir);
  const auto write = [&](const char* name, const char* text) {
    std::ofstream(absl::StrCat(dir, "/", name, ".json")) << text;
  };
  fs::copy(absl::StrCat(kShippedTracks, "/manipulation.json"), dir);
  fs::copy(FolderOf(1) + "/tracks/locomotion.json", dir);
  write("older", R"({"extends": "manipulation", "form": 1})");
  write("newer", R"({"extends": "locomotion", "form": 2})");
  write("same", R"({"extends": "locomotion", "form": 1})");
  for (const char* name : {"older", "newer"}) {
    const auto config = LoadTrackConfig(dir, name, "");
    EXPECT_THAT(std::string(config.status().message()),
                HasSubstr(absl::StrCat(name, ".json: \"form\" is ")));
  }
  EXPECT_TRUE(LoadTrackConfig(dir, "same", "").ok());
  fs::remove_all(dir);
}

TEST(TrackConfigForms, ANewerFormAndWhatIsNoneAreTold) {
  json config = OldConfigs(1).front().config;
  config["form"] = kTrackConfigForm + 1;
  const auto newer = ParseTrackConfig(config, "test");
  EXPECT_TRUE(absl::IsFailedPrecondition(newer.status())) << newer.status();
  EXPECT_THAT(std::string(newer.status().message()), HasSubstr("use a newer build"));
  for (const json& bad : {json(0), json(-1), json(1.5), json("2"), json(), json(true)}) {
    config["form"] = bad;
    EXPECT_TRUE(absl::IsInvalidArgument(ParseTrackConfig(config, "test").status())) << bad;
  }
}

}  // namespace
}  // namespace myograde
