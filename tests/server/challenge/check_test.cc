// What CheckChallenges finds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/challenge/challenge_world.h"

namespace myograde::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Json = nlohmann::json;

ChallengeFindings Check(const std::vector<Json>& phases, absl::Time now = absl::InfinitePast()) {
  return CheckChallenges({ChallengeOf(phases)}, ShippedTracks(), now);
}

TEST(CheckChallenges, AChallengeWithoutAMistakeIsFine) {
  const ChallengeFindings found = Check({
      PhaseJson("warm-up", {{"opens_at", "2026-12-01T00:00:00Z"},
                            {"closes_at", "2026-12-08T00:00:00Z"}}),
      PhaseJson("walk", {{"track", kLeg}}),
      PhaseJson("open", {{"seeds", {{"first", 5000}, {"count", 20}}}}),
      PhaseJson("final", {{"seeds", {{"committed", 20}}},
                          {"opens_at", "2026-12-08T00:00:00Z"},
                          {"freeze_at", "2026-12-08T00:00:00Z"},
                          {"closes_at", "2026-12-09T00:00:00Z"},
                          {"entry", "chosen"},
                          {"show", {{"aggregate", false}, {"metrics", false}}}}),
  });
  EXPECT_THAT(found.mistakes, IsEmpty());
  EXPECT_THAT(found.warnings, IsEmpty());
}

TEST(CheckChallenges, UnknownTracksAndProfilesAreNamed) {
  EXPECT_THAT(Check({PhaseJson("a", {{"track", "flying"}}), PhaseJson("b", {{"profile", "odd"}})})
                  .mistakes,
              ElementsAre(AllOf(HasSubstr("cup.json: phase \"a\": "), HasSubstr("\"flying\"")),
                          AllOf(HasSubstr("cup.json: phase \"b\": "), HasSubstr("\"odd\""))));
}

TEST(CheckChallenges, TimesMustFollowOneAnother) {
  const char* early = "2026-12-01T00:00:00Z";
  const char* late = "2026-12-09T00:00:00Z";
  const auto mistakes = [](const Json& more) { return Check({PhaseJson("a", more)}).mistakes; };
  EXPECT_THAT(mistakes({{"opens_at", late}, {"closes_at", early}}),
              ElementsAre(HasSubstr("must be later than \"opens_at\"")));
  EXPECT_THAT(mistakes({{"opens_at", early}, {"closes_at", early}}),
              ElementsAre(HasSubstr("must be later than \"opens_at\"")));
  EXPECT_THAT(mistakes({{"opens_at", late}, {"freeze_at", early}}),
              ElementsAre(HasSubstr("must lie between")));
  EXPECT_THAT(mistakes({{"closes_at", early}, {"freeze_at", late}}),
              ElementsAre(HasSubstr("must lie between")));
}

TEST(CheckChallenges, ANameIsThatOfOnePhase) {
  const std::vector<ChallengeConfig> two = {
      ChallengeOf({PhaseJson("final")}, "spring"),
      ChallengeOf({PhaseJson("final", {{"seeds", {700}}})}, "autumn")};
  EXPECT_THAT(CheckChallenges(two, ShippedTracks(), absl::InfinitePast()).mistakes,
              ElementsAre(AllOf(HasSubstr("autumn.json: phase \"final\""),
                                HasSubstr("taken by spring.json"))));
}

TEST(CheckChallenges, NoSeedIsPublicTwice) {
  EXPECT_THAT(Check({PhaseJson("a"), PhaseJson("b")}).mistakes,
              ElementsAre(AllOf(HasSubstr("phase \"b\": 100 of its seeds, from 0 on, belong to "
                                          "phase \"a\" too"))));
  EXPECT_THAT(Check({PhaseJson("a", {{"seeds", {99, 500}}})}).mistakes,
              ElementsAre(HasSubstr("its seed 99 belongs to track \"manipulation\" itself too")));
  EXPECT_THAT(Check({PhaseJson("a", {{"seeds", {500, 501}}}), PhaseJson("b", {{"seeds", {501}}})})
                  .mistakes,
              ElementsAre(HasSubstr("its seed 501 belongs to phase \"a\" too")));
  EXPECT_THAT(Check({PhaseJson("a", {{"seeds", {{"first", 150}, {"count", 100}}}})}).mistakes,
              ElementsAre(HasSubstr("belong to the practice of track ")));
  // In another environment it is another episode.
  EXPECT_THAT(Check({PhaseJson("a"), PhaseJson("b", {{"track", kLeg}})}).mistakes, IsEmpty());
}

TEST(CheckChallenges, WhatWouldTellACommittedSeedIsAMistake) {
  EXPECT_THAT(Check({PhaseJson("a", {{"seeds", {{"committed", 5}}},
                                     {"closes_at", "2026-12-01T00:00:00Z"},
                                     {"show", {{"logs", true}}}})})
                  .mistakes,
              ElementsAre(HasSubstr("a log holds its episode's seed")));
}

TEST(CheckChallenges, AggregatesThatTheBoardShowsCantBeHidden) {
  const Json hidden = {{"opens_at", "2026-12-01T00:00:00Z"}, {"show", {{"aggregate", false}}}};
  EXPECT_THAT(Check({PhaseJson("a", hidden)}).mistakes,
              ElementsAre(HasSubstr("the board would show the aggregates")));
}

TEST(CheckChallenges, WhatIsOddIsAWarning) {
  const auto warnings = [](const Json& more, const char* now = "2026-12-02T00:00:00Z") {
    const ChallengeFindings found = Check({PhaseJson("a", more)}, At(now));
    EXPECT_THAT(found.mistakes, IsEmpty());
    return found.warnings;
  };
  const char* first = "2026-12-01T00:00:00Z";
  const char* third = "2026-12-03T00:00:00Z";
  EXPECT_THAT(warnings({{"opens_at", third}}), IsEmpty());
  EXPECT_THAT(warnings({{"opens_at", first}}), ElementsAre(HasSubstr("is in the past")));
  EXPECT_THAT(warnings({{"closes_at", first}}), ElementsAre(HasSubstr("it closed at")));
  EXPECT_THAT(warnings({{"seeds", {{"committed", 5}}}}), ElementsAre(HasSubstr("never closes")));
  EXPECT_THAT(warnings({{"quota", {{"official_per_day", 9}, {"official_total", 3}}}}),
              ElementsAre(HasSubstr("a team has 3 in all")));
  const auto quota = [&](int64_t per_day, int64_t total) {
    return warnings({{"opens_at", "2027-01-01T00:00:00Z"},
                     {"closes_at", "2027-03-01T00:00:00Z"},
                     {"quota", {{"official_per_day", per_day}, {"official_total", total}}}});
  };
  EXPECT_THAT(quota(2, 100), IsEmpty());
  EXPECT_THAT(quota(2, 500), ElementsAre(HasSubstr("never use up the 500")));
  EXPECT_THAT(quota(5, 20), ElementsAre(HasSubstr("has used up its 20 after 4 days")));
}

}  // namespace
}  // namespace myograde::server
