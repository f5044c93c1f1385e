// Track configs as files: "extends" and profiles, and the ranges of the published schema compared
// with the parser's.
#include <filesystem>
#include <fstream>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"
#include "sim/tracks.h"

namespace myograde {
namespace {

using nlohmann::json;
using testing::HasSubstr;

const char kTrackFiles[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

class TrackFiles : public testing::Test {
 protected:
  TrackFiles() {
    std::filesystem::remove_all(dir_);
    std::filesystem::create_directory(dir_);
    std::filesystem::copy(std::string(kTrackFiles) + "/manipulation.json", dir_);
  }
  ~TrackFiles() override { std::filesystem::remove_all(dir_); }

  void Write(const std::string& name, const std::string& text) {
    std::ofstream(dir_ + "/" + name + ".json") << text;
  }
  std::string ErrorOf(const std::string& track, const std::string& profile = "") {
    return std::string(LoadTrackConfig(dir_, track, profile).status().message());
  }

  // One folder per test, as CTest may run several at once.
  const std::string dir_ = testing::TempDir() + "/track_files_" +
                           testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(TrackFiles, AnExtensionChangesWhatItNamesAndNothingElse) {
  Write("short", R"({"//": "comment", "extends": "manipulation", "seeds": [5, 7],
                     "budgets": {"tasks": 9}})");
  Write("shorter", R"({"extends": "short", "seeds": {"first": 4, "count": 1}})");
  const auto base = LoadTrackConfig(dir_, "manipulation", "").value();
  const auto made = LoadTrackConfig(dir_, "shorter", "");
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(made->id, "shorter");
  EXPECT_EQ(made->seeds, std::vector<uint64_t>{4});
  EXPECT_EQ(made->budgets.tasks, 9);
  EXPECT_EQ(made->budgets.step_s, base.budgets.step_s);
  EXPECT_EQ(made->rules, base.rules);
  EXPECT_NE(made->hash, base.hash);
}

TEST_F(TrackFiles, ExtraObservationsAreAllowedBesideTheConfigsHash) {
  const auto paper = LoadTrackConfig(dir_, "manipulation", "paper").value();
  const auto official = LoadTrackConfig(dir_, "manipulation", "myosuite").value();
  EXPECT_FALSE(paper.extra_observations);
  EXPECT_TRUE(official.extra_observations);
  EXPECT_TRUE(LoadTrackConfig(dir_, "manipulation", "as-graded")->extra_observations);
  EXPECT_TRUE(WithSeeds(official, {1})->extra_observations);
  EXPECT_TRUE(WithPhase(official, {{"phase", "final"}})->extra_observations);
  EXPECT_FALSE(official.effective.contains("extra_observations"));

  json file = *ReadJsonFile(dir_ + "/manipulation.json");
  file["profiles"]["myosuite"].erase("extra_observations");
  Write("manipulation", file.dump());
  const auto without = LoadTrackConfig(dir_, "manipulation", "myosuite").value();
  EXPECT_FALSE(without.extra_observations);
  EXPECT_EQ(without.hash, official.hash);
  file["profiles"]["myosuite"]["extra_observations"] = "yes";
  Write("manipulation", file.dump());
  EXPECT_THAT(ErrorOf("manipulation", "myosuite"),
              HasSubstr("(profile myosuite): \"extra_observations\" must be true or false"));

  EXPECT_TRUE(CheckExtraObservations(false, paper).ok());
  EXPECT_TRUE(CheckExtraObservations(true, official).ok());
  EXPECT_THAT(std::string(CheckExtraObservations(true, paper).message()),
              HasSubstr("profile \"paper\" of track \"manipulation\" does not allow"));
}

TEST_F(TrackFiles, AClientsFileTakesThePlaceOfTheTracksOwn) {
  const auto base = LoadTrackConfig(dir_, "manipulation", "").value();
  const json change = {{"extends", "manipulation"}, {"budgets", {{"tasks", 9}}}};
  const auto made = ResolveTrackConfig(dir_, "manipulation", "", change, "request: config");
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(made->id, "manipulation");
  EXPECT_EQ(made->budgets.tasks, 9);
  EXPECT_EQ(made->practice_seeds, base.practice_seeds);
  json same = *ReadJsonFile(dir_ + "/manipulation.json");
  EXPECT_EQ(ResolveTrackConfig(dir_, "manipulation", "", same, "request").value().hash, base.hash);
  same["budgets"].erase("tasks");
  const auto error = [&](const json& file) {
    return std::string(
        ResolveTrackConfig(dir_, "manipulation", "paper", file, "request: config").status().message());
  };
  EXPECT_THAT(error(same), testing::AllOf(HasSubstr("request: config"), HasSubstr("\"tasks\"")));
  EXPECT_THAT(error(json::array()), HasSubstr("request: config: must hold a JSON object"));
  EXPECT_THAT(error({{"extends", "../manipulation"}}), HasSubstr("is not a name of a track config"));
  EXPECT_THAT(error({{"extends", "none"}}), HasSubstr("there are: manipulation"));
  EXPECT_THAT(error({{"extends", 7}}), HasSubstr("\"extends\" must be the name"));
}

// What was published for the leg's track under the name as-graded is what the code does.
TEST(ShippedTracks, AsGradedOfTheLegIsMyosuiteUnderThatName) {
  const auto graded = LoadTrackConfig(kTrackFiles, "locomotion", "as-graded");
  ASSERT_TRUE(graded.ok()) << graded.status();
  json effective = LoadTrackConfig(kTrackFiles, "locomotion", "myosuite").value().effective;
  EXPECT_NE(graded->effective, effective);
  effective["profile"] = "as-graded";
  EXPECT_EQ(graded->effective, effective);
}

TEST_F(TrackFiles, AChainThatNeverEndsIsRefused) {
  Write("a", R"({"extends": "b"})");
  Write("b", R"({"extends": "a"})");
  Write("self", R"({"extends": "self"})");
  EXPECT_THAT(ErrorOf("a"), HasSubstr("b.json: \"extends\" leads back to \"a\""));
  EXPECT_THAT(ErrorOf("self"), HasSubstr("\"extends\" leads back to \"self\""));
}

TEST_F(TrackFiles, AMissingBaseIsNamedWithWhoWantsIt) {
  Write("orphan", R"({"extends": "nobody"})");
  EXPECT_THAT(ErrorOf("orphan"),
              testing::AllOf(HasSubstr("no track config \"nobody\""),
                             HasSubstr("orphan.json extends"),
                             HasSubstr("there are: manipulation")));
}

TEST_F(TrackFiles, BadFilesAreToldWithTheirPlace) {
  Write("outside", R"({"extends": "../manipulation"})");
  EXPECT_THAT(ErrorOf("outside"), HasSubstr("is not a name of a track config"));
  Write("number", R"({"extends": 3})");
  EXPECT_THAT(ErrorOf("number"), HasSubstr("number.json: \"extends\" must be the name"));
  Write("list", "[]");
  EXPECT_THAT(ErrorOf("list"), HasSubstr("list.json: must hold a JSON object"));
  Write("empty", "{}");
  EXPECT_THAT(ErrorOf("empty"), HasSubstr("\"profiles\" must be an object"));
  Write("twice", R"({"extends": "manipulation", "extends": "manipulation"})");
  EXPECT_THAT(ErrorOf("twice"), HasSubstr("twice.json: the key \"extends\" appears twice"));
  Write("named", R"({"extends": "manipulation", "id": "other"})");
  EXPECT_THAT(ErrorOf("named"), HasSubstr("\"id\" is given by the file's name"));
  Write("key", R"({"extends": "manipulation", "profiles": {"paper": {"track": "locomotion"}}})");
  EXPECT_THAT(ErrorOf("key"), HasSubstr("profile \"paper\": \"track\" can't be changed"));
  Write("default", R"({"extends": "manipulation", "default_profile": "none"})");
  EXPECT_THAT(ErrorOf("default"), HasSubstr("\"default_profile\" must be one of: as-graded"));
  Write("limit", R"({"extends": "manipulation", "budgets": {"tasks": null}})");
  EXPECT_THAT(ErrorOf("limit"), HasSubstr("budgets: \"tasks\" is missing"));
}

const json& Schema() {
  static const json schema =
      ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/schema/track.json").value();
  return schema;
}

// JSON pointers to the numbers that a schema object bounds, with their schemas.
void Bounded(const json& node, const std::string& pointer, std::map<std::string, json>& found) {
  if (node.contains("$ref")) {
    const std::string place = node["$ref"].get<std::string>().substr(1);
    return Bounded(Schema()[json::json_pointer(place)], pointer, found);
  }
  if (node.contains("minimum")) found[pointer] = node;
  if (node.contains("items")) Bounded(node["items"], pointer + "/0", found);
  if (!node.contains("properties")) return;
  for (const auto& [key, child] : node["properties"].items()) {
    Bounded(child, pointer + "/" + key, found);
  }
}

json SchemaOf(const std::string& part) {
  return Schema()["$defs"][part];
}

TEST(TrackSchema, HasTheParsersRangesOfBudgets) {
  const auto good = LoadTrackConfig(kTrackFiles, "manipulation", "").value();
  std::map<std::string, json> bounded;
  Bounded(SchemaOf("budgets"), "/budgets", bounded);
  EXPECT_EQ(bounded.size(), good.effective["budgets"].size());
  for (const auto& [pointer, range] : bounded) {
    const bool whole = range["type"] == "integer";
    const auto accepts = [&, &pointer = pointer](const json& edge, int beyond) {
      json effective = good.effective;
      json& value = effective[json::json_pointer(pointer)];
      if (whole) {
        value = edge.get<int64_t>() + beyond;
      } else {
        value = edge.get<double>() * (1 + beyond * 1e-9);
      }
      return ParseTrackConfig(effective, "test").ok();
    };
    EXPECT_TRUE(accepts(range["minimum"], 0)) << pointer;
    EXPECT_TRUE(accepts(range["maximum"], 0)) << pointer;
    EXPECT_FALSE(accepts(range["minimum"], -1)) << pointer;
    EXPECT_FALSE(accepts(range["maximum"], 1)) << pointer;
  }
}

// Rules depend on each other, so only values outside the schema are tried here.
TEST(TrackSchema, RefusesNoRuleThatTheParserAccepts) {
  for (const std::string& track : TrackNames()) {
    const TrackConfig good = LoadTrackConfig(kTrackFiles, track, "").value();
    std::map<std::string, json> bounded;
    Bounded(SchemaOf(track + "_rules"), "", bounded);
    EXPECT_GE(bounded.size(), 4u);
    for (const auto& [pointer, range] : bounded) {
      if (!good.rules.contains(json::json_pointer(pointer))) continue;  // of another profile
      const double low = range["minimum"], high = range["maximum"];
      for (const double outside : {low - 1, high + 1}) {
        TrackConfig config = good;
        json& value = config.rules[json::json_pointer(pointer)];
        value = outside;
        if (range["type"] == "integer") value = static_cast<int64_t>(outside);
        EXPECT_TRUE(absl::IsInvalidArgument(sim::MakeEnvironment(config, "/nowhere").status()))
            << pointer << " = " << value;
      }
    }
  }
}

}  // namespace
}  // namespace myograde
