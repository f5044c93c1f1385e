// Boards as a function of aggregates and marks.
#include "server/grading/leaderboard.h"

#include <algorithm>
#include <set>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "scoring/aggregate_json.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using scoring::TeamRule;

constexpr scoring::TieredBoard kTiered;
constexpr scoring::Metric kMetrics[] = {
    {.name = "time_s", .title = "time", .unit = "s", .ranked = true},
    {.name = "pain", .title = "pain", .unit = ""},  // one that is not ranked does not end the list
    {.name = "effort", .title = "effort", .unit = "", .ranked = true}};

const scoring::TrackScoring& Scoring() {
  static const scoring::ScoredTrack kTrack = {
      .name = "t", .metrics = kMetrics, .null_metrics = {}, .null_means = {}, .null_spreads = {},
      .parse = nullptr};
  static const scoring::TrackScoring kScoring = {
      .track = &kTrack, .judge = nullptr, .team = TeamRule::kBest, .boards = {}};
  return kScoring;
}

StandingRow Row(int64_t submission, const std::string& team, int successes, double time,
                double effort) {
  const nlohmann::json aggregate = {{"episodes", 100}, {"successes", successes},
                                    {"time_s", time},  {"effort", effort},
                                    {"pain", nullptr}, {"distance_m", nullptr}};
  return {.submission = submission,
          .evaluation = submission + 100,
          .team = team,
          .artefact_name = "policy",
          .aggregate = aggregate};
}

void Set(Marks& marks, int64_t submission, const std::string& mark, const std::string& why = "") {
  marks[{submission, mark}] = {{0, 1, "uid 0", why}, submission, mark, true};
}

std::vector<std::string> PlacesOf(const Leaderboard& board) {
  std::vector<std::string> places;
  for (const LeaderboardRow& row : board.rows) {
    places.push_back(absl::StrCat(row.ranked.rank, ":", row.source.submission));
  }
  return places;
}

Leaderboard Make(const std::vector<StandingRow>& rows, const Marks& marks) {
  absl::StatusOr<Leaderboard> board = MakeLeaderboard(rows, marks, kTiered, Scoring());
  EXPECT_TRUE(board.ok()) << board.status();
  return board.ok() ? *std::move(board) : Leaderboard();
}

TEST(Leaderboard, HonoursEveryMark) {
  const std::vector<StandingRow> rows = {Row(1, "alpha", 40, 9, 0.1), Row(2, "alpha", 30, 9, 0.1),
                                         Row(3, "beta", 35, 9, 0.1), Row(4, "gamma", 20, 9, 0.1)};
  EXPECT_THAT(PlacesOf(Make(rows, {})), ElementsAre("1:1", "2:3", "3:4"));
  Marks marks;
  Set(marks, 1, kHidden);
  EXPECT_THAT(PlacesOf(Make(rows, marks)), ElementsAre("1:3", "2:2", "3:4"));
  Set(marks, 3, kBaseline);
  EXPECT_THAT(PlacesOf(Make(rows, marks)), ElementsAre("0:3", "1:2", "2:4"));
  Set(marks, 4, kDisqualified, "reads the seeds");
  const Leaderboard board = Make(rows, marks);
  EXPECT_THAT(PlacesOf(board), ElementsAre("0:3", "1:2"));
  ASSERT_EQ(board.disqualified.size(), 1u);
  EXPECT_EQ(board.disqualified[0].mark.why, "reads the seeds");
}

TEST(Leaderboard, AFastBaselineOpensNoBand) {
  // On its own, 2 opens the band that contains 3, whose effort is less. The baseline is so fast
  // that with it neither would be in its band.
  const std::vector<StandingRow> rows = {
      Row(1, "ours", 95, 2.0, 0.5), Row(2, "alpha", 95, 4.0, 0.2), Row(3, "beta", 95, 4.3, 0.1)};
  Marks marks;
  Set(marks, 1, kBaseline);
  EXPECT_THAT(PlacesOf(Make(rows, marks)), ElementsAre("0:1", "1:3", "2:2"));
}

TEST(Leaderboard, RanksByTheNumbersOfAnAggregate) {
  const StandingRow whole = Row(1, "alpha", 50, 9, 0.1);
  EXPECT_TRUE(HasRankedNumbers(*Scoring().track, whole.aggregate));
  StandingRow without = Row(2, "beta", 50, 1, 0.1);
  without.aggregate["time_s"] = nullptr;  // none ranks behind every number
  EXPECT_TRUE(HasRankedNumbers(*Scoring().track, without.aggregate));
  EXPECT_THAT(PlacesOf(Make({without, whole}, {})), ElementsAre("1:1", "2:2"));
  without.aggregate.erase("pain");
  EXPECT_TRUE(HasRankedNumbers(*Scoring().track, without.aggregate)) << "it is not ranked by";
  for (const char* key : {"time_s", "effort"}) {
    StandingRow lacking = whole;
    lacking.aggregate.erase(key);
    EXPECT_FALSE(HasRankedNumbers(*Scoring().track, lacking.aggregate)) << key;
  }
  EXPECT_FALSE(HasRankedNumbers(*Scoring().track, nullptr));
}

TEST(Leaderboard, ExplainsByNumberAndByTeamAndSaysWhyNot) {
  const std::vector<StandingRow> rows = {Row(1, "alpha", 40, 9, 0.1), Row(2, "alpha", 30, 9, 0.1),
                                         Row(3, "beta", 35, 9, 0.1), Row(4, "7", 20, 9, 0.1),
                                         Row(5, "gamma", 10, 9, 0.1)};
  Marks marks;
  Set(marks, 5, kHidden);
  const auto explain = [&](const std::string& a, const std::string& b) {
    const auto found = ExplainOrder(rows, marks, kTiered, Scoring(), a, b);
    return found.ok() ? found->sentence : std::string(found.status().message());
  };
  EXPECT_THAT(explain("3", "1"), HasSubstr("alpha (rank 1) stands above beta (rank 2)"));
  EXPECT_THAT(explain("beta", "alpha"), HasSubstr("40 of 100 episodes against 35 of 100"));
  EXPECT_THAT(explain("beta", "7"), HasSubstr("beta (rank 2) stands above 7 (rank 3)"));
  EXPECT_THAT(explain("2", "3"), HasSubstr("its team's entry is submission 1"));
  EXPECT_THAT(explain("5", "3"), HasSubstr("it is hidden"));
  EXPECT_THAT(explain("99", "3"), HasSubstr("no finished ranked evaluation"));
  EXPECT_THAT(explain("nobody", "3"), HasSubstr("no team \"nobody\""));
  EXPECT_THAT(explain("1", "alpha"), HasSubstr("the same row"));
  Set(marks, 1, kBaseline);
  EXPECT_THAT(explain("1", "3"), HasSubstr("alpha (baseline) stands above beta (rank 1)"));
}

RC_GTEST_PROP(BoardProperty, MarksTakeAwayAndChangeNoOrder, ()) {
  const int count = *rc::gen::inRange(1, 12);
  std::vector<StandingRow> rows;
  Marks marks;
  std::set<int64_t> out;
  for (int64_t id = 1; id <= count; ++id) {
    rows.push_back(Row(id, absl::StrCat("team ", *rc::gen::inRange(0, 5)),
                       *rc::gen::inRange(85, 100), *rc::gen::inRange(1, 6),
                       *rc::gen::inRange(0, 4) / 8.0));
    const int mark = *rc::gen::inRange(0, 6);
    if (mark == 0) Set(marks, id, kHidden);
    if (mark == 1) Set(marks, id, kDisqualified, "why");
    if (mark == 2) Set(marks, id, kBaseline);
    if (mark <= 2) out.insert(id);
  }
  const Leaderboard marked = Make(rows, marks);
  // The ranks are those of a board without the marked rows.
  std::vector<StandingRow> rest;
  for (const StandingRow& row : rows) {
    if (!out.contains(row.submission)) rest.push_back(row);
  }
  std::vector<std::string> ranked;
  size_t baselines = 0;
  for (const LeaderboardRow& row : marked.rows) {
    if (row.ranked.rank == 0) {
      ++baselines;
      RC_ASSERT(marks.contains({row.source.submission, kBaseline}));
    } else {
      ranked.push_back(absl::StrCat(row.ranked.rank, ":", row.source.submission));
    }
  }
  RC_ASSERT(ranked == PlacesOf(Make(rest, {})));
  RC_ASSERT(baselines == static_cast<size_t>(std::count_if(
                             marks.begin(), marks.end(), [](const auto& entry) {
                               return entry.first.second == kBaseline;
                             })));
  // The order of the input rows does not matter.
  std::vector<StandingRow> shuffled = rows;
  std::reverse(shuffled.begin(), shuffled.end());
  RC_ASSERT(PlacesOf(Make(shuffled, marks)) == PlacesOf(marked));
}

}  // namespace
}  // namespace myograde::server
