// Edges of boards: what an entry may lack, what its numbers may be, and where lines and bands end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "scoring/board.h"
#include "scoring/groups.h"

namespace myograde::scoring {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr TieredBoard kTieredBoard = {
    .line_successes = 9, .line_episodes = 10, .band_factor = 1.5, .time = 0, .effort = 1};
constexpr ScoreBoard kByScore = {.score = 0, .effort = 1};
constexpr TieredBoard kRateBands = {.line_successes = 5,
                                    .line_episodes = 10,
                                    .bands = BandsOver::kSuccess,
                                    .band_factor = 1.25,
                                    .time = 0,
                                    .effort = 1};
constexpr DistanceBoard kDistances = {.time_from_m = 20, .distance = 0, .time = 1};
constexpr DistanceBoard kDistanceBands = {
    .time_from_m = 20, .band = 0.25, .distance = 0, .time = 1};
constexpr PhysiologicalBoard kBodies = {.qualify_m = 20, .distance = 0, .pain = 1, .effort = 2};

using Numbers = std::vector<std::optional<double>>;

BoardEntry With(const std::string& name, int64_t acceptance, int64_t successes,
                const Numbers& numbers) {
  BoardEntry entry{.submission = name, .team = "team " + name, .acceptance = acceptance};
  entry.episodes = 100;
  entry.successes = successes;
  entry.numbers = numbers;
  return entry;
}

std::vector<std::string> OrderOf(const std::vector<BoardEntry>& entries, const BoardRules& rules,
                                 TeamRule team = TeamRule::kBest) {
  std::vector<std::string> names;
  const auto board = *Rank(entries, rules, team);
  for (const RankedEntry& ranked : board) names.push_back(ranked.entry.submission);
  return names;
}

// Three metrics that are shown without digits after the point.
constexpr Metric kWhole[] = {{.name = "a", .title = "", .unit = "", .digits = 0, .ranked = true},
                             {.name = "b", .title = "", .unit = "", .digits = 0, .ranked = true},
                             {.name = "c", .title = "", .unit = "", .digits = 0, .ranked = true}};

// Why the first of two stands above the second.
std::string Why(const BoardEntry& above, const BoardEntry& below, const BoardRules& rules) {
  const auto board = *Rank({below, above}, rules, TeamRule::kBest);
  EXPECT_EQ(board.at(0).entry.submission, above.submission);
  return Explain(board.at(0), board.at(1), rules, kWhole);
}

TEST(MakeEntry, HasTheRankedMeansAndTheCounts) {
  constexpr Metric kThreeMetrics[] = {{.name = "a", .title = "", .unit = "", .ranked = true},
                                      {.name = "b", .title = "", .unit = ""},
                                      {.name = "c", .title = "", .unit = "", .ranked = true}};
  Aggregate aggregate;
  aggregate.episodes = 7;
  aggregate.successes = 3;
  aggregate.failed = true;
  aggregate.means = {{.value = 1.5, .count = 7, .spread = {}},
                     {.value = 2.5, .count = 7, .spread = {}},
                     {.value = 0, .count = 0, .spread = {}}};
  const BoardEntry entry = MakeEntry(kThreeMetrics, aggregate);
  EXPECT_TRUE(entry.failed);
  EXPECT_EQ(entry.episodes, 7);
  EXPECT_EQ(entry.successes, 3);
  EXPECT_THAT(entry.numbers, ElementsAre(1.5, std::nullopt));
  aggregate.failed = false;
  aggregate.means[2].count = 1;
  EXPECT_FALSE(MakeEntry(kThreeMetrics, aggregate).failed);
  EXPECT_THAT(MakeEntry(kThreeMetrics, aggregate).numbers, ElementsAre(1.5, 0.0));
}

TEST(Board, RefusesEntriesThatCantBe) {
  const auto refuses = [](const BoardEntry& entry, const BoardRules& rules) {
    return !Rank({entry}, rules, TeamRule::kBest).ok();
  };
  BoardEntry entry = With("s", 1, 100, {1, 1});
  EXPECT_FALSE(refuses(entry, kTieredBoard));
  EXPECT_FALSE(refuses(entry, kDistances));
  EXPECT_TRUE(refuses(entry, kBodies)) << "it ranks by a third number";
  entry.numbers.push_back(std::nullopt);
  EXPECT_FALSE(refuses(entry, kBodies));
  entry.numbers[2] = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(refuses(entry, kTieredBoard)) << "numbers that the board does not look at count too";
  entry.numbers = {1};
  EXPECT_TRUE(refuses(entry, kTieredBoard));
  EXPECT_TRUE(refuses(entry, kDistances));
  // The places may come in any order.
  constexpr TieredBoard kTurned = {.time = 1, .effort = 0};
  constexpr DistanceBoard kTurnedDistances = {.distance = 1, .time = 0};
  constexpr PhysiologicalBoard kTurnedBodies = {.distance = 2, .pain = 1, .effort = 0};
  EXPECT_TRUE(refuses(entry, kTurned));
  EXPECT_TRUE(refuses(entry, kTurnedDistances));
  entry.numbers = {1, 1};
  EXPECT_FALSE(refuses(entry, kTurned));
  EXPECT_FALSE(refuses(entry, kTurnedDistances));
  EXPECT_TRUE(refuses(entry, kTurnedBodies));
  for (const auto& [successes, episodes] :
       std::vector<std::pair<int64_t, int64_t>>{{-1, 10}, {11, 10}, {0, 0}, {-1, 0}}) {
    entry.successes = successes;
    entry.episodes = episodes;
    EXPECT_TRUE(refuses(entry, kTieredBoard)) << successes << " of " << episodes;
    // Nobody looks at the numbers of an entry that has no rank.
    entry.failed = true;
    EXPECT_FALSE(refuses(entry, kTieredBoard));
    entry.failed = false;
  }
  for (const auto& [successes, episodes] :
       std::vector<std::pair<int64_t, int64_t>>{{0, 1}, {1, 1}}) {
    entry.successes = successes;
    entry.episodes = episodes;
    EXPECT_FALSE(refuses(entry, kTieredBoard)) << successes << " of " << episodes;
  }
}

TEST(Board, LeavesOutTheFailedAndNobodyElse) {
  BoardEntry failed = With("failed", 1, 0, {1, 1});
  failed.failed = true;
  EXPECT_THAT(OrderOf({failed, With("a", 2, 1, {1, 1}), With("b", 3, 0, {1, 1})}, kTieredBoard),
              ElementsAre("a", "b"));
}

TEST(Board, QualifiedIsWhoReachesTheLine) {
  EXPECT_TRUE(IsQualified(With("s", 1, 90, {1, 1}), kTieredBoard));
  EXPECT_FALSE(IsQualified(With("s", 1, 89, {1, 1}), kTieredBoard));
  for (const BoardRules& rules : {BoardRules(kDistances), BoardRules(kBodies)}) {
    EXPECT_TRUE(IsQualified(With("s", 1, 0, {20, 1, 1}), rules));
    EXPECT_FALSE(IsQualified(With("s", 1, 0, {19.9, 1, 1}), rules));
    EXPECT_FALSE(IsQualified(With("s", 1, 0, {std::nullopt, 1, 1}), rules));
  }
  constexpr DistanceBoard kFromTheStart = {.time_from_m = 0.5, .distance = 0, .time = 1};
  EXPECT_FALSE(IsQualified(With("s", 1, 0, {std::nullopt, 1}), kFromTheStart))
      << "none is no metre";
}

TEST(Board, WithoutADistanceThereIsNoPlaceAmongBodies) {
  EXPECT_THAT(OrderOf({With("none", 1, 0, {std::nullopt, 1, 1}), With("near", 2, 0, {19.9, 1, 1}),
                       With("line", 3, 0, {20, 2, 1}), With("far", 4, 0, {21, 1, 1})},
                      kBodies),
              ElementsAre("far", "line"));
  EXPECT_THAT(
      OrderOf({With("near", 2, 0, {0.5, 1}), With("none", 1, 0, {std::nullopt, 1})}, kDistances),
      ElementsAre("near", "none"));
}

TEST(Board, BandsHoldWhatIsExactlyAtTheirFactor) {
  // 15 is 1.5 times 10 exactly, and less effort ranks inside a band.
  EXPECT_THAT(OrderOf({With("fast", 1, 95, {10, 3}), With("edge", 2, 95, {15, 2}),
                       With("out", 3, 95, {15.01, 1}), With("next", 4, 95, {22.5, 0})},
                      kTieredBoard),
              ElementsAre("edge", "fast", "next", "out"));
  EXPECT_THAT(OrderOf({With("best", 1, 100, {1, 3}), With("edge", 2, 80, {1, 2}),
                       With("out", 3, 79, {1, 1}), With("half", 4, 50, {1, 0})},
                      kRateBands),
              ElementsAre("edge", "best", "out", "half"));
  EXPECT_THAT(OrderOf({With("far", 1, 0, {100, 3}), With("edge", 2, 0, {80, 2}),
                       With("out", 3, 0, {79.9, 1}), With("line", 4, 0, {20, 0})},
                      kDistanceBands),
              ElementsAre("edge", "far", "out", "line"));
  const auto board = *Rank({With("fast", 1, 95, {10, 3}), With("out", 3, 95, {15.01, 1})},
                           kTieredBoard, TeamRule::kBest);
  EXPECT_EQ(board[0].band, 0);
  EXPECT_EQ(board[1].band, 1);
  EXPECT_EQ(board[0].band_opener, 10);
  EXPECT_EQ(board[1].band_opener, 15.01);
  EXPECT_EQ(board[0].rank, 1);
  EXPECT_EQ(board[1].rank, 2);
}

TEST(Board, TimeCountsFromTheLineItselfOn) {
  for (const DistanceBoard& rules : {kDistances, kDistanceBands}) {
    EXPECT_THAT(OrderOf({With("slow", 1, 0, {20, 2}), With("fast", 2, 0, {20, 1})}, rules),
                ElementsAre("fast", "slow"));
    EXPECT_THAT(OrderOf({With("slow", 1, 0, {19.9, 2}), With("fast", 2, 0, {19.9, 1})}, rules),
                ElementsAre("slow", "fast"));
  }
}

TEST(Board, ATeamStandsWithWhatItsRuleSays) {
  std::vector<BoardEntry> own = {With("best", 5, 95, {1, 1}), With("chosen", 6, 95, {2, 1}),
                                 With("unchosen", 7, 95, {3, 1}), With("last", 8, 95, {4, 1})};
  for (BoardEntry& entry : own) entry.team = "one";
  EXPECT_THAT(OrderOf(own, kTieredBoard), ElementsAre("best"));
  EXPECT_THAT(OrderOf(own, kTieredBoard, TeamRule::kLast), ElementsAre("last"));
  EXPECT_THAT(OrderOf(own, kTieredBoard, TeamRule::kChosen), ElementsAre());
  own[0].chosen = own[1].chosen = true;
  EXPECT_THAT(OrderOf(own, kTieredBoard, TeamRule::kChosen), ElementsAre("chosen"));
  std::reverse(own.begin(), own.end());
  EXPECT_THAT(OrderOf(own, kTieredBoard, TeamRule::kLast), ElementsAre("last"));
  EXPECT_THAT(OrderOf(own, kTieredBoard, TeamRule::kChosen), ElementsAre("chosen"));
}

TEST(Explain, GivesTheWholeSentenceOfTieredBoards) {
  EXPECT_EQ(Why(With("a", 1, 95, {10, 2}), With("b", 2, 95, {16, 1}), kTieredBoard),
            "team a (rank 1) stands above team b (rank 2): its mean time is 10 s against 16 s, which is more "
            "than 1.5 "
            "times the 10 s that opened its band (band 1 against 2).");
  EXPECT_EQ(Why(With("a", 1, 95, {12, 1}), With("b", 2, 95, {10, std::nullopt}), kTieredBoard),
            "team a (rank 1) stands above team b (rank 2): both mean times, 12 s and 10 s, are at most 1.5 "
            "times the "
            "10 s that opened band 1, and its effort is less, 1 against none.");
  EXPECT_EQ(Why(With("a", 1, 95, {10, 1}), With("b", 2, 95, {11, 1}), kTieredBoard),
            "team a (rank 1) stands above team b (rank 2): both mean times, 10 s and 11 s, are at most 1.5 "
            "times the "
            "10 s that opened band 1, both efforts are 1, and it was accepted first, as submission 1 "
            "against 2.");
  EXPECT_EQ(Why(With("a", 1, 100, {1, 1}), With("b", 2, 79, {1, 0}), kRateBands),
            "team a (rank 1) stands above team b (rank 2): it succeeded in 100 of 100 episodes against 79 of "
            "100, whose "
            "rate times 1.25 is less than the 100 % that opened its band (band 1 against 2).");
  EXPECT_EQ(Why(With("a", 1, 80, {1, 1}), With("b", 2, 100, {1, 2}), kRateBands),
            "team a (rank 1) stands above team b (rank 2): both success rates, 80 of 100 and 100 of 100, "
            "times 1.25 are "
            "at least the 100 % that opened band 1, and its effort is less, 1 against 2.");
  EXPECT_EQ(Why(With("a", 1, 90, {9, 9}), With("b", 2, 89, {1, 1}), kTieredBoard),
            "team a (rank 1) stands above team b (rank 2): it succeeded in 90 of 100 episodes, which reaches "
            "the line of 90 %, against 89 of 100, which does not.");
  EXPECT_EQ(
      Why(With("a", 1, 80, {9, 9}), With("b", 2, 79, {1, 1}), kTieredBoard),
      "team a (rank 1) stands above team b (rank 2): it succeeded in 80 of 100 episodes against 79 of 100.");
  const std::string equal =
      "team a (rank 1) stands above team b (rank 2): both succeeded at the same rate, 80 of 100 and "
      "80 of 100 episodes";
  EXPECT_EQ(Why(With("a", 2, 80, {1, 9}), With("b", 1, 80, {2, 1}), kTieredBoard),
            equal + ", and its mean time is 1 s against 2 s.");
  EXPECT_EQ(Why(With("a", 2, 80, {1, 1}), With("b", 1, 80, {1, 2}), kTieredBoard),
            equal + ", both mean times are 1 s, and its effort is less, 1 against 2.");
  TieredBoard by_acceptance = kTieredBoard;
  by_acceptance.ties = Ties::kAcceptance;
  EXPECT_EQ(Why(With("a", 1, 80, {2, 2}), With("b", 2, 80, {1, 1}), by_acceptance),
            equal + ", and it was accepted first, as submission 1 against 2.");
}

TEST(Explain, GivesTheWholeSentenceOfTheOtherBoards) {
  const std::string above = "team a (rank 1) stands above team b (rank 2): ";
  EXPECT_EQ(Why(With("a", 1, 0, {30, 2}), With("b", 2, 0, {29, 1}), kDistances),
            above + "its mean distance is 30 m against 29 m.");
  EXPECT_EQ(Why(With("a", 2, 0, {30, 1}), With("b", 1, 0, {30, 2}), kDistances),
            above + "both mean distances are 30 m, and its mean time is 1 s against 2 s.");
  EXPECT_EQ(Why(With("a", 1, 0, {30, 1}), With("b", 2, 0, {30, 1}), kDistances),
            above +
                "both mean distances are 30 m, both mean times are 1 s, and it was accepted first, "
                "as submission 1 "
                "against 2.");
  EXPECT_EQ(Why(With("a", 1, 0, {19, 2}), With("b", 2, 0, {19, 1}), kDistances),
            above +
                "both mean distances are 19 m, less than the 20 m from which time decides, and it "
                "was accepted "
                "first, as submission 1 against 2.");
  EXPECT_EQ(Why(With("a", 1, 0, {25, 2}), With("b", 2, 0, {19, 1}), kDistanceBands),
            above + "its mean distance is 25 m against 19 m.");
  EXPECT_EQ(Why(With("a", 1, 0, {100, 2}), With("b", 2, 0, {79, 1}), kDistanceBands),
            above +
                "its mean distance is 100 m against 79 m, which times 1.25 is less than the 100 m "
                "that opened "
                "its band (band 1 against 2).");
  EXPECT_EQ(Why(With("a", 1, 0, {80, 1}), With("b", 2, 0, {100, 2}), kDistanceBands),
            above +
                "both mean distances, 80 m and 100 m, times 1.25 are at least the 100 m that "
                "opened band 1, and "
                "its mean time is 1 s against 2 s.");
  EXPECT_EQ(Why(With("a", 2, 0, {100, 1}), With("b", 1, 0, {80, 1}), kDistanceBands),
            above +
                "both mean distances, 100 m and 80 m, times 1.25 are at least the 100 m that "
                "opened band 1, both "
                "mean times are 1 s, and its mean distance is larger.");
  EXPECT_EQ(Why(With("a", 1, 0, {30, 1, 9}), With("b", 2, 0, {30, 2, 1}), kBodies),
            above + "its mean pain over all steps is less, 1 against 2.");
  EXPECT_EQ(
      Why(With("a", 2, 0, {30, 1, 1}), With("b", 1, 0, {30, 1, 2}), kBodies),
      above + "both mean pains over all steps are 1, and its mean effort is less, 1 against 2.");
  PhysiologicalBoard of_episodes = kBodies;
  of_episodes.means = MeansOver::kEpisodes;
  EXPECT_EQ(
      Why(With("a", 1, 0, {30, 1, 1}), With("b", 2, 0, {30, 1, 1}), of_episodes),
      above +
          "both mean pains are 1, both mean efforts are 1, and it was accepted first, as submission 1 "
          "against 2.");
}

TEST(Explain, HasTheDigitsOfTheMetricAndMoreWhereNumbersWouldLookAlike) {
  EXPECT_THAT(Why(With("a", 1, 95, {10.44, 2.0004}), With("b", 2, 95, {10.2, 2.0006}), kTieredBoard),
              AllOf(HasSubstr("both mean times, 10.4 s and 10.2 s, are at most 1.5 times the 10.2 s"),
                    HasSubstr("less, 2.000 against 2.001.")));
  EXPECT_THAT(Why(With("a", 1, 95, {10.4, 2}), With("b", 2, 95, {10.4, 2}), kTieredBoard),
              HasSubstr("both mean times, 10 s and 10 s, are"));
  RankedEntry baseline{.entry = With("a", 1, 95, {1, 1})};
  RankedEntry ranked{.entry = With("b", 2, 90, {1, 1}), .rank = 4};
  EXPECT_THAT(Explain(baseline, ranked, kTieredBoard, kWhole),
              HasSubstr("team a (baseline) stands above team b (rank 4)"));
}

TEST(DescribeBand, SaysWhatItsRowsHaveInCommonAndWhatDecides) {
  const auto words = [](int64_t band, double opener, const BoardRules& rules) {
    return DescribeBand({.entry = {}, .rank = 1, .band = band, .band_opener = opener}, rules, kWhole);
  };
  EXPECT_EQ(words(0, 10, kTieredBoard), "Band 1, within 50 % of the fastest, 10 s: effort decides");
  EXPECT_EQ(words(1, 16, kTieredBoard), "Band 2, within 50 % of its fastest, 16 s: effort decides");
  EXPECT_EQ(words(-1, 0, kTieredBoard), "Success rates below 90 %: successes decide");
  EXPECT_EQ(words(0, 0.95, kRateBands),
            "Band 1, success rates of at least 95 % / 1.25: effort decides");
  EXPECT_EQ(words(1, 40, kDistanceBands),
            "Band 2, distances of at least 40 m / 1.25: time decides");
  EXPECT_EQ(words(-1, 0, kDistanceBands), "Below 20 m: distance decides");
  EXPECT_EQ(words(0, 40, kDistances), "");
  EXPECT_EQ(words(-1, 0, kBodies), "");
  using Kind = Criterion::Kind;
  EXPECT_EQ(CriterionWithin({.entry = {}, .band = 0}, kTieredBoard), (Criterion{Kind::kNumber, 1}));
  EXPECT_EQ(CriterionWithin({.entry = {}}, kTieredBoard), Criterion{Kind::kSuccess});
  EXPECT_EQ(CriterionWithin({.entry = {}, .band = 0}, kDistanceBands), (Criterion{Kind::kNumber, 1}));
  EXPECT_EQ(CriterionWithin({.entry = {}, .band = 0}, kDistances), (Criterion{Kind::kNumber, 0}));
  EXPECT_EQ(CriterionWithin({.entry = {}}, kBodies), (Criterion{Kind::kNumber, 1}));
  EXPECT_EQ(CriterionWithin({.entry = {}}, kByScore), (Criterion{Kind::kNumber, 0}));
}

TEST(ScoreBoards, RankByScoreThenEffortThenAcceptance) {
  EXPECT_THAT(OrderOf({With("a", 1, 0, {0.4, 1}), With("b", 2, 0, {0.5, 9}),
                       With("c", 3, 0, {0.5, 8}), With("d", 4, 0, {std::nullopt, 1}),
                       With("e", 5, 0, {0.5, std::nullopt}), With("f", 6, 0, {0.5, 8})},
                      kByScore),
              ElementsAre("c", "f", "b", "e", "a", "d"));
  EXPECT_TRUE(IsQualified(With("a", 1, 0, {0, 1}), kByScore)) << "it has no line";
  const std::string above = "team a (rank 1) stands above team b (rank 2): ";
  EXPECT_EQ(Why(With("a", 1, 0, {0.5, 9}), With("b", 2, 0, {0.4, 1}), kByScore),
            above + "its mean score is 0.5 against 0.4.");
  EXPECT_EQ(Why(With("a", 2, 0, {1, 1}), With("b", 1, 0, {1, 2}), kByScore),
            above + "both mean scores are 1, and its effort is less, 1 against 2.");
  EXPECT_EQ(Why(With("a", 1, 0, {1, 1}), With("b", 2, 0, {1, 1}), kByScore),
            above + "both mean scores are 1, both efforts are 1, and it was accepted first, as "
                    "submission 1 against 2.");
}

TEST(Criteria, AreThoseOfTheBoard) {
  using Kind = Criterion::Kind;
  EXPECT_THAT(ListCriteria(kTieredBoard),
              ElementsAre(Criterion{Kind::kSuccess}, Criterion{Kind::kNumber, 0},
                          Criterion{Kind::kNumber, 1}));
  EXPECT_THAT(ListCriteria(kDistances),
              ElementsAre(Criterion{Kind::kNumber, 0}, Criterion{Kind::kNumber, 1}));
  EXPECT_THAT(ListCriteria(kBodies),
              ElementsAre(Criterion{Kind::kNumber, 1}, Criterion{Kind::kNumber, 2}));
  EXPECT_THAT(ListCriteria(kByScore),
              ElementsAre(Criterion{Kind::kNumber, 0}, Criterion{Kind::kNumber, 1}));
}

// The criterion between the first two of a board.
Criterion Between(const BoardEntry& above, const BoardEntry& below, const BoardRules& rules) {
  const auto board = *Rank({above, below}, rules, TeamRule::kBest);
  return CriterionOf(board.at(0), board.at(1), rules);
}

TEST(Criteria, AreWhatRanksOneAboveTheOther) {
  using Kind = Criterion::Kind;
  const Criterion success{Kind::kSuccess}, acceptance{Kind::kAcceptance};
  const Criterion first{Kind::kNumber, 0}, second{Kind::kNumber, 1}, third{Kind::kNumber, 2};
  EXPECT_EQ(Between(With("a", 1, 95, {1, 1}), With("b", 2, 95, {2, 1}), kTieredBoard), first);
  EXPECT_EQ(Between(With("a", 1, 95, {1, 1}), With("b", 2, 95, {1.2, 2}), kTieredBoard), second);
  EXPECT_EQ(Between(With("a", 1, 95, {1, 1}), With("b", 2, 95, {1.2, 1}), kTieredBoard),
            acceptance);
  EXPECT_EQ(Between(With("a", 1, 90, {1, 1}), With("b", 2, 80, {1, 1}), kTieredBoard), success);
  EXPECT_EQ(Between(With("a", 1, 81, {1, 1}), With("b", 2, 80, {1, 1}), kTieredBoard), success);
  EXPECT_EQ(Between(With("a", 1, 80, {1, 1}), With("b", 2, 80, {1, 2}), kTieredBoard), second);
  EXPECT_EQ(Between(With("a", 1, 100, {1, 1}), With("b", 2, 60, {1, 1}), kRateBands), success);
  EXPECT_EQ(Between(With("a", 1, 100, {1, 1}), With("b", 2, 90, {1, 2}), kRateBands), second);
  EXPECT_EQ(Between(With("a", 1, 0, {0.5, 1}), With("b", 2, 0, {0.4, 1}), kByScore), first);
  EXPECT_EQ(Between(With("a", 1, 0, {0.5, 1}), With("b", 2, 0, {0.5, 2}), kByScore), second);
  EXPECT_EQ(Between(With("a", 1, 0, {30, 1}), With("b", 2, 0, {29, 1}), kDistances), first);
  EXPECT_EQ(Between(With("a", 1, 0, {30, 1}), With("b", 2, 0, {30, 2}), kDistances), second);
  EXPECT_EQ(Between(With("a", 1, 0, {100, 1}), With("b", 2, 0, {90, 2}), kDistanceBands), second);
  EXPECT_EQ(Between(With("a", 1, 0, {100, 1}), With("b", 2, 0, {90, 1}), kDistanceBands), first);
  EXPECT_EQ(Between(With("a", 1, 0, {100, 1}), With("b", 2, 0, {70, 1}), kDistanceBands), first);
  EXPECT_EQ(Between(With("a", 1, 0, {19, 1}), With("b", 2, 0, {19, 2}), kDistances), acceptance);
  EXPECT_EQ(Between(With("a", 1, 0, {30, 1, 1}), With("b", 2, 0, {30, 2, 1}), kBodies), second);
  EXPECT_EQ(Between(With("a", 1, 0, {30, 1, 1}), With("b", 2, 0, {30, 1, 2}), kBodies), third);
}

}  // namespace
}  // namespace myograde::scoring
