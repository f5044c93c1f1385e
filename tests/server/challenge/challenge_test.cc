// Challenge files: what is read from them, and which are none.
#include "server/challenge/challenge.h"

#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/base/config_reader.h"
#include "tests/server/challenge/challenge_world.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Json = nlohmann::json;

std::string MistakeIn(const Json& challenge) {
  return std::string(ParseChallenge(challenge, "cup", "cup.json").status().message());
}

std::string MistakeOf(const Json& more) {
  return MistakeIn(ChallengeJson({PhaseJson("final", more)}));
}

TEST(Challenge, EveryKeyIsRead) {
  const ChallengeConfig challenge = ChallengeOf({PhaseJson(
      "final", {{"//", "a comment"},
                {"seeds", {{"committed", 40}}},
                {"opens_at", "2026-12-01T00:00:00Z"},
                {"closes_at", "2026-12-08T01:00:00+01:00"},
                {"freeze_at", "2026-12-07T12:00:00.5Z"},
                {"entry", "chosen"},
                {"teams", {"alpha", "Beta Lab"}},
                {"quota", {{"official_per_day", 2}, {"waiting", 3}, {"same_artefact", "everyone"}}},
                {"show", {{"metrics", false}, {"outcomes", false}}}})});
  EXPECT_EQ(challenge.name, "cup");
  EXPECT_EQ(challenge.title, "A cup");
  ASSERT_THAT(challenge.phases, SizeIs(1));
  const PhaseConfig& phase = challenge.phases.front();
  EXPECT_EQ(phase.name, "final");
  EXPECT_EQ(phase.challenge, "cup");
  EXPECT_EQ(phase.track, kArm);
  EXPECT_EQ(phase.profile, kProfile);
  EXPECT_EQ(phase.committed, 40);
  EXPECT_THAT(phase.seeds, IsEmpty());
  EXPECT_EQ(UtcText(phase.opens), "2026-12-01T00:00:00Z");
  EXPECT_EQ(UtcText(phase.closes), "2026-12-08T00:00:00Z");
  EXPECT_EQ(UtcText(phase.freezes), "2026-12-07T12:00:00.5Z");
  EXPECT_EQ(phase.entry, scoring::TeamRule::kChosen);
  EXPECT_EQ(phase.teams, (std::vector<std::string>{"alpha", "Beta Lab"}));
  EXPECT_FALSE(phase.shown.metrics);
  EXPECT_FALSE(phase.shown.outcomes);
  EXPECT_TRUE(phase.shown.aggregate);
  EXPECT_FALSE(phase.shown.logs) << "they hold committed seeds";
  EXPECT_FALSE(phase.shown.seeds);
}

TEST(Challenge, WhatIsLeftOutIsOpenPublicAndTheTracks) {
  const PhaseConfig phase = ChallengeOf({PhaseJson("warm-up")}).phases.at(0);
  EXPECT_EQ(phase.opens, absl::InfinitePast());
  EXPECT_EQ(phase.closes, absl::InfiniteFuture());
  EXPECT_EQ(phase.freezes, absl::InfiniteFuture());
  EXPECT_EQ(phase.entry, std::nullopt);
  EXPECT_THAT(phase.seeds, IsEmpty());
  EXPECT_EQ(phase.committed, 0);
  EXPECT_TRUE(phase.shown.logs);
  EXPECT_TRUE(phase.shown.seeds);
}

TEST(Challenge, PublicSeedsAreARangeOrAList) {
  const ChallengeConfig challenge =
      ChallengeOf({PhaseJson("a", {{"seeds", {{"first", 7}, {"count", 3}}}}),
                   PhaseJson("b", {{"seeds", {5, 1, 9}}})});
  EXPECT_THAT(challenge.phases[0].seeds, ElementsAre(7, 8, 9));
  EXPECT_THAT(challenge.phases[1].seeds, ElementsAre(5, 1, 9));
}

TEST(Challenge, AMistakeIsNamedWithFilePhaseAndKey) {
  const std::pair<Json, const char*> mistakes[] = {
      {{{"colour", 1}}, "\"colour\""},
      {{{"track", "../x"}}, "\"track\" must have 1 to 64"},
      {{{"title", "a\nb"}}, "\"title\" must be 1 to 200 bytes"},
      {{{"opens_at", "2026-12-01"}}, "\"opens_at\" must be a time with a zone"},
      {{{"opens_at", "2026-12-01T00:00:00"}}, "\"opens_at\" must be a time with a zone"},
      {{{"closes_at", " 2026-12-01T00:00:00Z"}}, "\"closes_at\" must be a time with a zone"},
      {{{"closes_at", "infinite-future"}}, "\"closes_at\" must be a time with a zone"},
      {{{"closes_at", "1999-12-01T00:00:00Z"}}, "\"closes_at\" must lie in the years 2000"},
      {{{"freeze_at", 5}}, "\"freeze_at\" must be a string"},
      {{{"entry", "first"}}, "\"entry\" is \"first\", must be one of: best, last, chosen"},
      {{{"seeds", {{"committed", 0}}}}, "seeds: \"committed\" is 0, must be from 1 to 10000"},
      {{{"seeds", {{"committed", 5}, {"first", 1}}}}, "seeds: \"first\""},
      {{{"seeds", {{"first", 1}, {"count", 10001}}}}, "seeds: \"count\" is 10001"},
      {{{"seeds", {1, 1}}}, "the seed 1 appears twice"},
      {{{"seeds", "all"}}, "seeds: must be"},
      {{{"quota", {{"official_total", 0}}}}, "quota: \"official_total\" is 0, must be from 1"},
      {{{"quota", {{"practice_total", 5}}}}, "quota: \"practice_total\" is not a key of a phase"},
      {{{"quota", 5}}, "\"quota\" must be an object"},
      {{{"teams", Json::array()}}, "\"teams\" must be 1 to 10000 names of teams"},
      {{{"teams", {"a\nb"}}}, "\"teams\" must be 1 to 10000 names of teams"},
      {{{"show", {{"films", true}}}}, "show: \"films\""},
      {{{"show", {{"logs", "no"}}}}, "show: \"logs\" must be true or false"},
      {{{"statistics", 5}}, "\"statistics\" must be an object"},
      {{{"statistics", {{"power", 1}}}}, "statistics: \"power\""},
      {{{"statistics", {{"level", 2}}}}, "statistics: \"level\" is 2"},
  };
  for (const auto& [more, what] : mistakes) {
    const std::string mistake = MistakeOf(more);
    EXPECT_THAT(mistake, HasSubstr("cup.json: phase \"final\": ")) << more;
    EXPECT_THAT(mistake, HasSubstr(what));
  }
}

TEST(Challenge, AFileHasAFormATitleAndPhases) {
  EXPECT_THAT(MistakeIn(Json::array()), HasSubstr("cup.json: must be an object"));
  Json json = ChallengeJson({PhaseJson("final")});
  json["form"] = 2;
  EXPECT_THAT(MistakeIn(json), HasSubstr("\"form\" is 2"));
  EXPECT_THAT(MistakeIn(ChallengeJson({})), HasSubstr("\"phases\" has 0 entries"));
  EXPECT_THAT(MistakeIn(ChallengeJson({5})), HasSubstr("cup.json: phases[0]: must be an object"));
  EXPECT_THAT(MistakeIn(ChallengeJson({PhaseJson("Final")})), HasSubstr("phases[0]: \"name\""));
  const std::vector<Json> many(kMaxPhases + 1, PhaseJson("final"));
  EXPECT_THAT(MistakeIn(ChallengeJson(many)), HasSubstr("\"phases\" has 101 entries"));
}

TEST(Challenge, EachPhasesMistakeIsCollected) {
  std::vector<std::string> mistakes;
  const ChallengeConfig challenge = ReadChallenge(
      ChallengeJson({PhaseJson("a", {{"x", 1}}), PhaseJson("b"), PhaseJson("c", {{"y", 1}})}), "cup",
      "cup.json", mistakes);
  EXPECT_THAT(mistakes, ElementsAre(HasSubstr("\"a\""), HasSubstr("\"c\"")));
  EXPECT_THAT(challenge.phases, SizeIs(1));
  EXPECT_THAT(std::string(MistakesToStatus(mistakes).message()), HasSubstr("first of 2 mistakes"));
}

TEST(Challenge, OwnKeysOfAQuotaReplaceTheServers) {
  const AdmissionRules fallback = {
      .quota = {.ranked = {5, 100}, .practice = {50, 500}, .failed = {7, 70}, .waiting = 9}};
  const AdmissionRules same = PhaseRules(ChallengeOf({PhaseJson("a")}).phases[0], fallback);
  EXPECT_EQ(same.quota.ranked.total, 100);
  EXPECT_FALSE(same.one_for_everyone);
  const PhaseConfig own = ChallengeOf({PhaseJson(
      "a", {{"quota", {{"official_total", 3}, {"failed_per_day", 2},
                       {"same_artefact", "everyone"}}}})}).phases[0];
  const AdmissionRules rules = PhaseRules(own, fallback);
  EXPECT_EQ(rules.quota.ranked.per_day, 5);
  EXPECT_EQ(rules.quota.ranked.total, 3);
  EXPECT_EQ(rules.quota.failed.per_day, 2);
  EXPECT_EQ(rules.quota.failed.total, 70);
  EXPECT_TRUE(rules.one_for_everyone);
}

TEST(Challenge, APhaseThatWithholdsAnythingAllowsFewFailedTries) {
  const AdmissionRules fallback = {
      .quota = {.ranked = {5, 100}, .practice = {50, 500}, .failed = {1000, 10000}, .waiting = 9}};
  const auto failed = [&](const nlohmann::json& more) {
    return PhaseRules(ChallengeOf({PhaseJson("a", more)}).phases[0], fallback).quota.failed.total;
  };
  EXPECT_EQ(failed(nlohmann::json::object()), 10000);
  EXPECT_EQ(failed({{"show", {{"metrics", false}}}}), 20);
  EXPECT_EQ(failed({{"seeds", {{"committed", 5}}}}), 20);
  EXPECT_EQ(failed({{"show", {{"metrics", false}}}, {"quota", {{"failed_total", 50}}}}), 50);
}

TEST(Challenge, OwnKeysOfStatisticsReplaceTheServers) {
  const scoring::StatisticsConfig fallback = {.groups = {.level = 0.02, .samples = 5000, .places = 4}};
  EXPECT_EQ(*PhaseStatistics(ChallengeOf({PhaseJson("a")}).phases[0], fallback), fallback);
  const PhaseConfig own = ChallengeOf({PhaseJson(
      "a", {{"statistics", {{"places", 6}, {"ranks", "groups"}}}})}).phases[0];
  const scoring::StatisticsConfig config = *PhaseStatistics(own, fallback);
  EXPECT_EQ(config.groups, (scoring::GroupRules{.level = 0.02, .samples = 5000, .places = 6}));
  EXPECT_EQ(config.ranks, scoring::StatisticsConfig::Ranks::kGroups);
  // It fits by itself, but not a server with so few samples.
  const PhaseConfig many =
      ChallengeOf({PhaseJson("a", {{"statistics", {{"places", 40}}}})}).phases[0];
  const std::string mistake(PhaseStatistics(many, fallback).status().message());
  EXPECT_THAT(mistake, HasSubstr("phase \"a\": statistics: \"samples\" is 5000"));
}

TEST(Challenge, AnyTimeIsReadAsItIsWritten) {
  EXPECT_TRUE(rc::check([] {
    const auto seconds = *rc::gen::inRange<int64_t>(946'684'800, 253'402'214'400);
    const std::string text = UtcText(absl::FromUnixSeconds(seconds));
    const auto challenge = ParseChallenge(
        ChallengeJson({PhaseJson("final", {{"opens_at", text}})}), "cup", "cup.json");
    RC_ASSERT(challenge.ok());
    RC_ASSERT(challenge->phases[0].opens == absl::FromUnixSeconds(seconds));
  }));
}

// The first block of JSON in the documentation.
std::string DocumentedExample() {
  std::ifstream file(MYOGRADE_SOURCE_DIR "/configs/challenges/README.md");
  std::stringstream text;
  text << file.rdbuf();
  const std::string all = text.str();
  const size_t begin = all.find("```json\n");
  const size_t end = all.find("\n```", begin);
  if (begin == std::string::npos || end == std::string::npos) return "";
  return all.substr(begin + 8, end - begin - 8);
}

TEST(Challenge, TheDocumentedExampleIsOneWithoutAMistake) {
  const absl::StatusOr<Json> json = ParseJson(DocumentedExample(), "README.md");
  ASSERT_TRUE(json.ok()) << json.status();
  const auto challenge = ParseChallenge(*json, "example", "README.md");
  ASSERT_TRUE(challenge.ok()) << challenge.status();
  EXPECT_GE(challenge->phases.size(), 2u);
  const ChallengeFindings found =
      CheckChallenges({*challenge}, ShippedTracks(), absl::InfinitePast());
  EXPECT_THAT(found.mistakes, IsEmpty());
  EXPECT_THAT(found.warnings, IsEmpty());
}

TEST(Challenge, NoneIsShippedThatWouldBeLoaded) {
  std::vector<std::string> mistakes;
  EXPECT_THAT(ReadChallenges(MYOGRADE_SOURCE_DIR "/configs/challenges", mistakes), IsEmpty());
  EXPECT_THAT(mistakes, IsEmpty());
}

}  // namespace
}  // namespace myograde::server
