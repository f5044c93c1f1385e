#include "scoring/board.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocol/base/config_reader.h"

namespace myograde::scoring {
namespace {

using nlohmann::json;

// The numbers of the tests' entries, and boards over them.
enum Number : size_t { kMeanDistance, kMeanTime, kMeanEffort, kMeanPain, kEffortOfSteps, kPainOfSteps, kNumbers };

constexpr Metric kOfNumbers[] = {
    {.name = "distance", .title = "", .unit = "", .digits = 0, .ranked = true},
    {.name = "time", .title = "", .unit = "", .digits = 0, .ranked = true},
    {.name = "effort", .title = "", .unit = "", .digits = 1, .ranked = true},
    {.name = "pain", .title = "", .unit = "", .digits = 1, .ranked = true},
    {.name = "effort_over_steps", .title = "", .unit = "", .digits = 1, .ranked = true},
    {.name = "pain_over_steps", .title = "", .unit = "", .digits = 1, .ranked = true}};

TieredBoard Tiered(TieredBoard board = {}) {
  board.time = kMeanTime;
  board.effort = kMeanEffort;
  return board;
}

DistanceBoard OfDistance(DistanceBoard board = {}) {
  board.distance = kMeanDistance;
  board.time = kMeanTime;
  return board;
}

PhysiologicalBoard Physiological(MeansOver means = MeansOver::kSteps) {
  const bool steps = means == MeansOver::kSteps;
  return {.means = means,
          .distance = kMeanDistance,
          .pain = steps ? kPainOfSteps : kMeanPain,
          .effort = steps ? kEffortOfSteps : kMeanEffort};
}

constexpr ScoreBoard kScores = {.score = kMeanDistance, .effort = kMeanEffort};

BoardEntry EntryOf(const json& row) {
  BoardEntry entry;
  entry.submission = row.at("submission");
  entry.team = row.at("team");
  entry.acceptance = row.at("acceptance");
  entry.chosen = row.value("chosen", false);
  entry.failed = row.value("failed", false);
  entry.successes = row.value("successes", 0);
  entry.episodes = 100;
  entry.numbers.resize(kNumbers);
  entry.numbers[kMeanTime] = row.value("time", 0.0);
  entry.numbers[kMeanDistance] = row.value("distance", 0.0);
  if (row.contains("effort")) entry.numbers[kMeanEffort] = row["effort"].get<double>();
  if (row.contains("pain")) entry.numbers[kMeanPain] = row["pain"].get<double>();
  if (row.contains("effort_over_steps")) {
    entry.numbers[kEffortOfSteps] = row["effort_over_steps"].get<double>();
  }
  if (row.contains("pain_over_steps")) {
    entry.numbers[kPainOfSteps] = row["pain_over_steps"].get<double>();
  }
  return entry;
}

BoardRules RulesOf(const json& board) {
  const std::string kind = board.at("kind");
  if (kind == "distance") return OfDistance({.band = board.value("band", 0.0)});
  if (kind == "physiological") {
    const bool steps = board.value("means", "steps") == "steps";
    return Physiological(steps ? MeansOver::kSteps : MeansOver::kEpisodes);
  }
  TieredBoard tiered = Tiered();
  if (board.value("bands", "time") == "success") tiered.bands = BandsOver::kSuccess;
  if (board.value("ties", "time") == "acceptance") tiered.ties = Ties::kAcceptance;
  return tiered;
}

TeamRule TeamRuleOf(const std::string& name) {
  if (name == "last") return TeamRule::kLast;
  return name == "chosen" ? TeamRule::kChosen : TeamRule::kBest;
}

std::vector<std::string> Names(const std::vector<RankedEntry>& board) {
  std::vector<std::string> names;
  for (const RankedEntry& ranked : board) names.push_back(ranked.entry.submission);
  return names;
}

const RankedEntry& Find(const std::vector<RankedEntry>& board, const std::string& name) {
  return *std::find_if(board.begin(), board.end(),
                       [&](const auto& ranked) { return ranked.entry.submission == name; });
}

// Every file in boards/: rows in, order out. A new case needs no change here.
TEST(Board, AgreesWithTheTables) {
  int files = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(MYOGRADE_SOURCE_DIR "/tests/scoring/boards")) {
    SCOPED_TRACE(file.path().filename().string());
    const auto table = ReadJsonFile(file.path().string());
    ASSERT_TRUE(table.ok()) << table.status();
    std::vector<BoardEntry> entries;
    for (const json& row : table->at("rows")) entries.push_back(EntryOf(row));
    const BoardRules rules = RulesOf(table->at("board"));
    const auto board = Rank(entries, rules, TeamRuleOf(table->at("team")));
    ASSERT_TRUE(board.ok()) << board.status();
    ASSERT_EQ(Names(*board), table->at("order").get<std::vector<std::string>>());
    for (const json& why : table->at("why")) {
      EXPECT_THAT(Explain(Find(*board, why[0]), Find(*board, why[1]), rules, kOfNumbers),
                  testing::HasSubstr(why[2].get<std::string>()));
    }
    ++files;
  }
  EXPECT_GE(files, 12);
}

TEST(Board, TellsItsOrderInWords) {
  using testing::AllOf;
  using testing::HasSubstr;
  EXPECT_THAT(
      DescribeOrder(Tiered({.line_successes = 8, .line_episodes = 10})),
      AllOf(HasSubstr("a success rate of at least 80 %"), HasSubstr("bands of mean time"),
            HasSubstr("1.1 times"), HasSubstr("equal by less mean time, then by less effort"),
            HasSubstr("order of acceptance")));
  const TieredBoard by_acceptance = Tiered({.ties = Ties::kAcceptance});
  EXPECT_THAT(DescribeOrder(by_acceptance), HasSubstr("effort does not count below that line"));
  EXPECT_THAT(DescribeOrder(Tiered({.bands = BandsOver::kSuccess})),
              HasSubstr("bands of the success rate"));
  EXPECT_THAT(DescribeOrder(OfDistance({.time_from_m = 25})), HasSubstr("at least 25 m"));
  EXPECT_THAT(DescribeOrder(OfDistance({.band = 0.25})), HasSubstr("distance times 1.25"));
  EXPECT_THAT(DescribeOrder(kScores), AllOf(HasSubstr("By mean score"), HasSubstr("less mean effort"),
                                            HasSubstr("order of acceptance")));
  EXPECT_THAT(DescribeOrder(Physiological()), HasSubstr("both over all steps"));
  EXPECT_THAT(DescribeOrder(Physiological(MeansOver::kEpisodes)),
              HasSubstr("both over episodes"));
  // The words of the line hold: by acceptance neither time nor effort moves anybody. Whoever
  // changes that changes the words.
  BoardEntry first{.submission = "first", .team = "a", .acceptance = 1};
  first.successes = 1;
  first.episodes = 100;
  first.numbers.resize(kNumbers);
  first.numbers[kMeanTime] = 9;
  first.numbers[kMeanEffort] = 0.9;
  BoardEntry second = first;
  second.submission = "second";
  second.team = "b";
  second.acceptance = 2;
  second.numbers[kMeanTime] = second.numbers[kMeanEffort] = 0.1;
  const auto board = Rank({second, first}, by_acceptance, TeamRule::kBest);
  ASSERT_TRUE(board.ok()) << board.status();
  EXPECT_EQ(Names(*board), (std::vector<std::string>{"first", "second"}));
  const auto by_time = Rank({second, first}, Tiered(), TeamRule::kBest);
  ASSERT_TRUE(by_time.ok()) << by_time.status();
  EXPECT_EQ(Names(*by_time), (std::vector<std::string>{"second", "first"}));
}

TEST(Board, RefusesNumbersThatAreNone) {
  BoardEntry entry{.submission = "s", .team = "t", .episodes = 100};
  EXPECT_FALSE(Rank({entry}, Tiered(), TeamRule::kBest).ok()) << "none of the numbers";
  entry.numbers.resize(kNumbers);
  entry.numbers[kMeanTime] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Rank({entry}, Tiered(), TeamRule::kBest).ok());
  entry.numbers[kMeanTime] = 1;
  EXPECT_FALSE(Rank({entry, entry}, Tiered(), TeamRule::kBest).ok()) << "same acceptance";
  entry.successes = 101;
  EXPECT_FALSE(Rank({entry}, Tiered(), TeamRule::kBest).ok());
}

// Few different values, so that ties, zeros of both signs and the smallest doubles are common.
rc::Gen<double> Values() {
  return rc::gen::element(-0.0, 0.0, 5e-324, 1.0, 1.1, 10.0, 11.0, 12.1, 20.0, 100.0);
}

std::vector<BoardEntry> SomeEntries() {
  const int count = *rc::gen::inRange(0, 12);
  std::vector<BoardEntry> entries;
  for (int i = 0; i < count; ++i) {
    BoardEntry entry;
    entry.submission = "s" + std::to_string(i);
    entry.team = "t" + std::to_string(*rc::gen::inRange(0, 8));
    entry.acceptance = i;
    entry.chosen = *rc::gen::arbitrary<bool>();
    entry.episodes = 100;
    entry.successes = *rc::gen::inRange(85, 96);
    entry.numbers.resize(kNumbers);
    entry.numbers[kMeanTime] = *Values();
    if (*rc::gen::inRange(0, 9) > 0) entry.numbers[kMeanEffort] = *Values();
    if (*rc::gen::inRange(0, 9) > 0) entry.numbers[kMeanPain] = *Values();
    if (*rc::gen::inRange(0, 9) > 0) entry.numbers[kEffortOfSteps] = *Values();
    if (*rc::gen::inRange(0, 9) > 0) entry.numbers[kPainOfSteps] = *Values();
    entry.numbers[kMeanDistance] = *Values();
    entries.push_back(entry);
  }
  return entries;
}

BoardRules SomeRules() {
  return *rc::gen::element<BoardRules>(
      Tiered(), Tiered({.bands = BandsOver::kSuccess}),
      Tiered({.ties = Ties::kAcceptance}), OfDistance(), Physiological(),
      Physiological(MeansOver::kEpisodes), kScores);
}

BoardRules RulesWithBands() {
  return *rc::gen::element<BoardRules>(Tiered(), OfDistance({.band = 0.1}));
}

RC_GTEST_PROP(Board, DoesNotDependOnTheOrderOfItsInput, ()) {
  std::vector<BoardEntry> entries = SomeEntries();
  const BoardRules rules = *rc::gen::arbitrary<bool>() ? SomeRules() : RulesWithBands();
  const TeamRule team = *rc::gen::element(TeamRule::kBest, TeamRule::kLast, TeamRule::kChosen);
  const auto expected = Names(*Rank(entries, rules, team));
  for (size_t i = entries.size(); i > 1; --i) {
    std::swap(entries[i - 1], entries[*rc::gen::inRange<size_t>(0, i)]);
  }
  RC_ASSERT(Names(*Rank(entries, rules, team)) == expected);
}

RC_GTEST_PROP(Board, HasEveryTeamOnceAndRanksWithoutGaps, ()) {
  const std::vector<BoardEntry> entries = SomeEntries();
  const auto board = *Rank(entries, Tiered(), TeamRule::kBest);
  std::set<std::string> expected, got;
  for (const BoardEntry& entry : entries) expected.insert(entry.team);
  for (size_t i = 0; i < board.size(); ++i) {
    RC_ASSERT(board[i].rank == static_cast<int64_t>(i) + 1);
    RC_ASSERT(got.insert(board[i].entry.team).second);
  }
  RC_ASSERT(got == expected);
}

int64_t RankOf(const std::string& team, const std::vector<RankedEntry>& board) {
  const auto row = std::find_if(board.begin(), board.end(), [&](const RankedEntry& ranked) {
    return ranked.entry.team == team;
  });
  return row == board.end() ? std::numeric_limits<int64_t>::max() : row->rank;
}

// Teams with several submissions each, most of them in bands that overlap.
std::vector<BoardEntry> SubmissionsOfFewTeams() {
  std::vector<BoardEntry> entries;
  const int count = *rc::gen::inRange(1, 16);
  for (int i = 0; i < count; ++i) {
    BoardEntry entry;
    entry.submission = "s" + std::to_string(i);
    entry.team = "t" + std::to_string(*rc::gen::inRange(0, 5));
    entry.acceptance = i;
    entry.episodes = 100;
    entry.successes = *rc::gen::inRange(88, 98);
    entry.numbers.resize(kNumbers);
    entry.numbers[kMeanTime] = 1 + *rc::gen::inRange(0, 12) / 20.0;
    entry.numbers[kMeanEffort] = entry.numbers[kMeanPain] = entry.numbers[kPainOfSteps] =
        entry.numbers[kEffortOfSteps] = *rc::gen::inRange(0, 12);
    entry.numbers[kMeanDistance] = *rc::gen::inRange(18, 30);
    entries.push_back(entry);
  }
  return entries;
}

BoardRules AnyRules() {
  return *rc::gen::element<BoardRules>(Tiered(), Tiered({.bands = BandsOver::kSuccess}),
                                       OfDistance({.band = 0.1}), OfDistance(), Physiological());
}

RC_GTEST_PROP(Board, SubmittingMoreNeverLowersTheOwnRank, ()) {
  std::vector<BoardEntry> entries = SubmissionsOfFewTeams();
  const BoardRules rules = AnyRules();
  const std::string team = entries.back().team;
  const auto after = *Rank(entries, rules, TeamRule::kBest);
  entries.pop_back();
  RC_ASSERT(RankOf(team, after) <= RankOf(team, *Rank(entries, rules, TeamRule::kBest)));
}

// Whenever it submitted them: where only one team has several submissions, each of them alone would
// rank no better.
RC_GTEST_PROP(Board, ATeamStandsWithTheSubmissionOfBestRank, ()) {
  std::vector<BoardEntry> entries = SubmissionsOfFewTeams();
  const BoardRules rules = AnyRules();
  for (size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].team != "t0") entries[i].team = "only " + entries[i].submission;
  }
  const int64_t rank = RankOf("t0", *Rank(entries, rules, TeamRule::kBest));
  int64_t best = std::numeric_limits<int64_t>::max();
  for (const BoardEntry& own : entries) {
    if (own.team != "t0") continue;
    std::vector<BoardEntry> with_one = {own};
    std::copy_if(entries.begin(), entries.end(), std::back_inserter(with_one),
                 [](const BoardEntry& entry) { return entry.team != "t0"; });
    best = std::min(best, RankOf("t0", *Rank(with_one, rules, TeamRule::kBest)));
  }
  RC_ASSERT(rank == best);
}

// Bands depend on who opens them, so a tiered board promises this for an entry that is worse
// than all others in everything; the other boards compare two entries at a time and promise it
// for every entry.
RC_GTEST_PROP(Board, ANewTeamLeavesTheOrderOfTheOthers, ()) {
  std::vector<BoardEntry> entries = SomeEntries();
  const BoardRules rules = SomeRules();
  const auto before = Names(*Rank(entries, rules, TeamRule::kBest));
  BoardEntry added{.submission = "new", .team = "new", .acceptance = 99, .episodes = 100};
  added.numbers.resize(kNumbers);
  added.numbers[kMeanTime] = 1000;
  added.numbers[kMeanEffort] = 1000;
  if (std::holds_alternative<TieredBoard>(rules)) {
    added.successes = *rc::gen::element(0, 85);
  } else {
    added.numbers[kMeanTime] = *Values();
    added.numbers[kMeanPain] = *Values();
    added.numbers[kPainOfSteps] = *Values();
    added.numbers[kMeanDistance] = *Values();
  }
  entries.push_back(added);
  auto after = Names(*Rank(entries, rules, TeamRule::kBest));
  std::erase(after, "new");
  RC_ASSERT(after == before);
}

// Whoever opens a band of distance is followed by nobody of it who is faster, and nobody of a
// later band is within the factor of what opened the one before.
RC_GTEST_PROP(Board, BandsOfDistanceHoldWhatIsNear, ()) {
  const DistanceBoard rules = OfDistance({.band = 0.1});
  const auto board = *Rank(SomeEntries(), rules, TeamRule::kBest);
  for (size_t i = 1; i < board.size(); ++i) {
    const RankedEntry& above = board[i - 1];
    const RankedEntry& below = board[i];
    if (below.band < 0) {
      RC_ASSERT(*above.entry.numbers[kMeanDistance] >= *below.entry.numbers[kMeanDistance]);
      continue;
    }
    RC_ASSERT(above.band >= 0);
    RC_ASSERT(*above.entry.numbers[kMeanDistance] >= 20);
    if (above.band == below.band) {
      RC_ASSERT(*above.entry.numbers[kMeanTime] <= *below.entry.numbers[kMeanTime]);
      RC_ASSERT(*below.entry.numbers[kMeanDistance] * 1.1 >= above.band_opener);
    } else {
      RC_ASSERT(below.band == above.band + 1);
      RC_ASSERT(*below.entry.numbers[kMeanDistance] * 1.1 < above.band_opener);
    }
  }
}

// "Stands above" of the boards that compare two entries at a time is transitive, also for the
// board of each pair alone: three entries that follow each other on boards of two do so on one
// of three. With bands this holds below the line and inside a band only, where the success rate
// or effort alone decides; the entries of a tiered board are drawn so.
RC_GTEST_PROP(Board, PairsThatFollowEachOtherMakeTheWholeBoard, ()) {
  const BoardRules rules = SomeRules();
  std::vector<BoardEntry> entries;
  for (int i = 0; i < 3; ++i) {
    BoardEntry entry;
    entry.submission = entry.team = std::string(1, static_cast<char>('a' + i));
    entry.episodes = 100;
    entry.acceptance = i;
    entry.numbers.resize(kNumbers);
    entry.numbers[kMeanEffort] = *Values();
    entry.numbers[kMeanPain] = *Values();
    entry.numbers[kEffortOfSteps] = *Values();
    entry.numbers[kPainOfSteps] = *Values();
    entry.numbers[kMeanDistance] = *rc::gen::element(20.0, 100.0);  // all qualify for the physiological board
    entry.numbers[kMeanTime] = *Values();
    entries.push_back(entry);
  }
  if (std::holds_alternative<TieredBoard>(rules)) {
    const bool below = *rc::gen::arbitrary<bool>();
    for (BoardEntry& entry : entries) {
      entry.successes = below ? *rc::gen::inRange(80, 90) : 95;
      if (!below) entry.numbers[kMeanTime] = *rc::gen::element(10.0, 10.5, 11.0);
    }
  }
  const auto above = [&](const BoardEntry& x, const BoardEntry& y) {
    return Names(*Rank({x, y}, rules, TeamRule::kBest)).front() == x.submission;
  };
  std::sort(entries.begin(), entries.end(), [](const auto& x, const auto& y) {
    return x.submission < y.submission;
  });
  do {
    if (!above(entries[0], entries[1]) || !above(entries[1], entries[2])) continue;
    RC_ASSERT(above(entries[0], entries[2]));
    const std::vector<std::string> whole = {entries[0].submission, entries[1].submission,
                                            entries[2].submission};
    RC_ASSERT(Names(*Rank(entries, rules, TeamRule::kBest)) == whole);
    return;
  } while (std::next_permutation(entries.begin(), entries.end(), [](const auto& x, const auto& y) {
    return x.submission < y.submission;
  }));
  RC_FAIL("no order of three in which each stands above the next");
}

}  // namespace
}  // namespace myograde::scoring
