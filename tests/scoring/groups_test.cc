#include "scoring/groups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <utility>

namespace myograde::scoring {
namespace {

using Kind = Criterion::Kind;
using testing::ElementsAre;

// A track of the tests' own: its ranked numbers are time, effort, distance, pain over steps.
constexpr Metric kTestedMetrics[] = {
    {.name = "time_s", .title = "time", .unit = "s", .better = Better::kLess, .ranked = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .ranked = true},
    {.name = "distance_m",
     .title = "distance",
     .unit = "m",
     .better = Better::kMore,
     .ranked = true},
    {.name = "pain_sum", .title = "pain sum", .unit = ""},
    {.name = "pain_over_steps",
     .title = "pain",
     .unit = "",
     .better = Better::kLess,
     .source = Metric::Source::kOverSteps,
     .of = "pain_sum",
     .ranked = true},
};
constexpr size_t kTimePlace = 0;
constexpr size_t kEffortPlace = 1;
constexpr size_t kDistancePlace = 2;
constexpr size_t kPainPlace = 3;
const BoardRules kTiers = TieredBoard{.time = kTimePlace, .effort = kEffortPlace};
const BoardRules kCourse = DistanceBoard{.distance = kDistancePlace, .time = kTimePlace};
const BoardRules kBody = PhysiologicalBoard{
    .qualify_m = 0, .distance = kDistancePlace, .pain = kPainPlace, .effort = kEffortPlace};

struct Played {
  bool success = true;
  double time = 1;
  double effort = 1;
  double distance = 100;
  double pain_sum = 10;
  int64_t steps = 10;
};

JudgedEpisode EpisodeOf(int64_t index, const Played& played) {
  Verdict verdict;
  verdict.outcome = played.success ? Outcome::kSuccess : Outcome::kFailure;
  verdict.steps = played.steps;
  verdict.metrics = {played.time, played.effort, played.distance, played.pain_sum, std::nullopt};
  return {index, verdict};
}

// What `play` says of each of the first `count` episodes.
template <typename Play>
std::vector<JudgedEpisode> Play100(Play play, int64_t count = 100) {
  std::vector<JudgedEpisode> episodes;
  for (int64_t i = 0; i < count; ++i) episodes.push_back(EpisodeOf(i, play(i)));
  return episodes;
}

// The board of entries that played these episodes, first place first.
std::vector<TestedRow> BoardOf(const std::vector<std::vector<JudgedEpisode>>& all,
                               const BoardRules& rules) {
  std::vector<BoardEntry> entries;
  for (const auto& episodes : all) {
    BoardEntry entry = MakeEntry(kTestedMetrics, *AggregateEpisodes(kTestedMetrics, episodes));
    entry.acceptance = std::ssize(entries);
    entry.team = entry.submission = std::to_string(entry.acceptance);
    entries.push_back(entry);
  }
  std::vector<TestedRow> rows;
  const std::vector<RankedEntry> board = *Rank(entries, rules, TeamRule::kBest);
  for (const RankedEntry& ranked : board) {
    rows.push_back({ranked, all.at(static_cast<size_t>(ranked.entry.acceptance))});
  }
  return rows;
}

std::vector<int64_t> GroupsOf(const std::vector<TestedRow>& rows, const BoardRules& rules,
                              const GroupRules& group_rules = {}) {
  std::vector<int64_t> groups;
  for (const PlaceInGroup& place : FormGroups(kTestedMetrics, rows, rules, group_rules).places) {
    groups.push_back(place.group);
  }
  return groups;
}

// The first `successes` episodes are.
std::vector<JudgedEpisode> Succeeds(int64_t successes) {
  return Play100([&](int64_t i) { return Played{.success = i < successes, .time = 5}; });
}

// Small differences that lean to neither side.
double Noise(int64_t i, double size) { return size * std::sin(12.9 * static_cast<double>(i)); }

TEST(Groups, AreGivenUpBetweenTwoTests) {
  const auto rows = BoardOf({Succeeds(80), Succeeds(78), Succeeds(50)}, kTiers);
  int asked = 0;
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {}, [&] { return ++asked > 2; });
  EXPECT_TRUE(groups.stopped);
  EXPECT_TRUE(groups.places.empty());
  EXPECT_EQ(asked, 3);
  EXPECT_FALSE(FormGroups(kTestedMetrics, rows, kTiers, {}, [] { return false; }).stopped);
}

TEST(Groups, HoldWhatSuccessesDoNotDecide) {
  const auto rows = BoardOf({Succeeds(80), Succeeds(78), Succeeds(50), Succeeds(49)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1, 2, 2));
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_EQ(groups.tests, 6);
  EXPECT_FALSE(groups.places[0].above.has_value());
  // Two episodes differ: 2 * (1/2)^2.
  EXPECT_DOUBLE_EQ(groups.places[1].above->test.p, 0.5);
  EXPECT_EQ(groups.places[2].opened_by, 0u);
  EXPECT_TRUE(groups.places[2].opener->decided);
  EXPECT_FALSE(groups.places[2].opener->reversed);
  EXPECT_EQ(groups.places[3].opened_by, 2u);
  EXPECT_FALSE(groups.places[3].opener->decided);
}

// A group may be decided against its opener only, and hold neighbours that are close to each other.
TEST(Groups, OpenWithTheFirstRowThatTheOpenerBeats) {
  const auto rows =
      BoardOf({Succeeds(80), Succeeds(74), Succeeds(68), Succeeds(62), Succeeds(56)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1, 2, 2, 3));
}

TEST(Groups, CompareBandsByTimeAndRowsOfABandByEffort) {
  const auto entry = [](double time, double effort, int64_t shift) {
    return Play100([=](int64_t i) {
      return Played{.time = time + Noise(i + shift, 0.05),
                    .effort = effort + Noise(i - shift, 0.3)};
    });
  };
  const auto rows = BoardOf(
      {entry(1, 1, 0), entry(1.01, 1.02, 3), entry(1.02, 1.5, 5), entry(2, 0.1, 7)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1, 2, 3));
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_EQ(groups.places[1].above->criterion, (Criterion{Kind::kNumber, kEffortPlace}));
  EXPECT_EQ(groups.places[3].above->criterion, (Criterion{Kind::kNumber, kTimePlace}));
}

TEST(Groups, CompareByTheLineAcrossIt) {
  const auto rows = BoardOf({Succeeds(90), Succeeds(89)}, kTiers);
  EXPECT_EQ(CriterionOf(rows[0].ranked, rows[1].ranked, kTiers), (Criterion{Kind::kSuccess}));
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1));
}

TEST(Groups, CompareEqualRatesBelowTheLineByTime) {
  const auto slow = Play100([](int64_t i) { return Played{.success = i < 50, .time = 5.5}; });
  const auto rows = BoardOf({Succeeds(50), slow}, kTiers);
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_EQ(groups.places[1].above->criterion, (Criterion{Kind::kNumber, kTimePlace}));
  EXPECT_TRUE(groups.places[1].above->decided);
  const BoardRules by_acceptance =
      TieredBoard{.ties = Ties::kAcceptance, .time = kTimePlace, .effort = kEffortPlace};
  EXPECT_EQ(CriterionOf(rows[0].ranked, rows[1].ranked, by_acceptance), Criterion{});
}

TEST(Groups, NeverDecideEqualRows) {
  const auto rows = BoardOf({Succeeds(50), Succeeds(50)}, kTiers);
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_EQ(groups.places[1].above->criterion.kind, Kind::kAcceptance);
  EXPECT_EQ(groups.places[1].above->test.p, 1);
  EXPECT_EQ(groups.places[1].above->test.pairs, 0) << "there is no number to compare";
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1));
}

TEST(Groups, CompareDistancesAndEqualOnesByTime) {
  const auto entry = [](double distance, double time) {
    return Play100(
        [=](int64_t i) { return Played{.time = time + Noise(i, 0.1), .distance = distance}; });
  };
  const auto rows = BoardOf({entry(100, 9), entry(100, 10), entry(60, 1), entry(5, 1)}, kCourse);
  const Groups groups = FormGroups(kTestedMetrics, rows, kCourse, {});
  EXPECT_EQ(groups.places[1].above->criterion, (Criterion{Kind::kNumber, kTimePlace}));
  EXPECT_EQ(groups.places[2].above->criterion, (Criterion{Kind::kNumber, kDistancePlace}));
  EXPECT_THAT(GroupsOf(rows, kCourse), ElementsAre(1, 2, 3, 4));
}

TEST(Groups, ComparePainOverSteps) {
  const auto entry = [](double pain, int64_t shift) {
    return Play100([=](int64_t i) {
      const int64_t steps = 50 + (i + shift) % 7;
      return Played{.pain_sum = (pain + Noise(i + shift, 0.5)) * static_cast<double>(steps),
                    .steps = steps};
    });
  };
  const auto rows = BoardOf({entry(1, 0), entry(1.01, 2), entry(2, 4)}, kBody);
  EXPECT_THAT(GroupsOf(rows, kBody), ElementsAre(1, 1, 2));
}

TEST(Groups, TestTheFirstPlacesOnly) {
  const auto rows = BoardOf({Succeeds(80), Succeeds(50), Succeeds(20)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers, {.places = 2}), ElementsAre(1, 2));
  EXPECT_THAT(GroupsOf({}, kTiers), ElementsAre());
}

// The same difference in three times the episodes.
TEST(Groups, LearnFromFurtherEpisodes) {
  auto rows = BoardOf({Succeeds(80), Succeeds(75)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1));
  for (TestedRow& row : rows) {
    const std::vector<JudgedEpisode> own = row.episodes;
    for (const int64_t further : {100, 200}) {
      for (JudgedEpisode episode : own) {
        episode.index += further;
        row.episodes.push_back(episode);
      }
    }
  }
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 2));
  // Those of one row alone are no pairs.
  rows[1].episodes.resize(100);
  EXPECT_THAT(GroupsOf(rows, kTiers), ElementsAre(1, 1));
  EXPECT_EQ(FormGroups(kTestedMetrics, rows, kTiers, {}).places[1].above->test.pairs, 100);
}

TEST(Groups, SayWhenFurtherEpisodesTurnTheOrder) {
  auto rows = BoardOf({Succeeds(80), Succeeds(75)}, kTiers);
  for (int64_t i = 100; i < 300; ++i) {
    rows[0].episodes.push_back(EpisodeOf(i, {.success = i % 2 == 0}));
    rows[1].episodes.push_back(EpisodeOf(i, {}));
  }
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_TRUE(groups.places[1].above->reversed);
  EXPECT_FALSE(groups.places[1].above->decided);
  EXPECT_EQ(groups.places[1].group, 1);
}

TEST(Groups, DecideNothingByALeadTheOtherWayThatMayBeLuck) {
  auto rows = BoardOf({Succeeds(80), Succeeds(79)}, kTiers);
  for (int64_t i = 100; i < 103; ++i) {
    rows[0].episodes.push_back(EpisodeOf(i, {.success = false}));
    rows[1].episodes.push_back(EpisodeOf(i, {}));
  }
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_LT(groups.places[1].above->test.difference, 0);
  EXPECT_FALSE(groups.places[1].above->reversed);
  EXPECT_FALSE(groups.places[1].above->decided);
}

TEST(Groups, DecideAtTheLevelItself) {
  // Six episodes differ: 2 * (1/2)^6.
  const auto rows = BoardOf({Succeeds(80), Succeeds(74)}, kTiers);
  EXPECT_THAT(GroupsOf(rows, kTiers, {.level = std::ldexp(1, -5)}), ElementsAre(1, 2));
  EXPECT_THAT(GroupsOf(rows, kTiers, {.level = std::ldexp(0.99, -5)}), ElementsAre(1, 1));
}

// Who never took a step has no mean over steps, and stands last without having lost a comparison.
TEST(Groups, DecideNothingAgainstARowWithoutAStep) {
  const auto walks = Play100([](int64_t) { return Played{.pain_sum = 5, .steps = 10}; }, 20);
  const auto stays = Play100([](int64_t) { return Played{.pain_sum = 0, .steps = 0}; }, 20);
  const auto rows = BoardOf({walks, stays}, kBody);
  const Groups groups = FormGroups(kTestedMetrics, rows, kBody, {});
  EXPECT_EQ(groups.places[1].above->criterion, (Criterion{Kind::kNumber, kPainPlace}));
  EXPECT_LE(groups.places[1].above->p_adjusted, 0.05);
  EXPECT_FALSE(groups.places[1].above->decided);
  EXPECT_FALSE(groups.places[1].above->reversed);
}

TEST(Groups, CorrectByHolm) {
  // p-values of the pairs: 1 against 2 differs in 6 episodes, 2 against 3 in 8, 1 against 3 in 14.
  const auto rows = BoardOf({Succeeds(80), Succeeds(74), Succeeds(66)}, kTiers);
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_DOUBLE_EQ(groups.places[2].above->test.p, std::ldexp(1, -7));
  EXPECT_DOUBLE_EQ(groups.places[2].above->p_adjusted, 2 * std::ldexp(1, -7));
  EXPECT_DOUBLE_EQ(groups.places[1].above->p_adjusted, std::ldexp(1, -5));
  EXPECT_DOUBLE_EQ(groups.places[2].opener->p_adjusted,
                   groups.places[1].above->decided ? 2 * std::ldexp(1, -7) : std::ldexp(3, -13));
}

// Two policies that are equally good, looked at again and again until their order is decided.
bool LooksTellThemApart(std::mt19937& random, int64_t most_looks) {
  std::bernoulli_distribution succeeds(0.5);
  std::vector<std::vector<JudgedEpisode>> all(2);
  std::vector<TestedRow> rows;
  for (int64_t look = 1; look <= most_looks; ++look) {
    for (auto& episodes : all) {
      for (int i = 0; i < 100; ++i) {
        episodes.push_back(EpisodeOf(std::ssize(episodes), {.success = succeeds(random)}));
      }
    }
    if (look == 1) {
      rows = BoardOf(all, kTiers);
    } else {
      for (TestedRow& row : rows) {
        row.episodes = all[static_cast<size_t>(row.ranked.entry.acceptance)];
        row.further.insert(100 * (look - 1));
      }
    }
    const PlaceTest test =
        *FormGroups(kTestedMetrics, rows, kTiers, {.further_looks = true}).places[1].above;
    EXPECT_EQ(test.looks, look);
    if (test.decided || test.reversed) return true;
  }
  return false;
}

TEST(Groups, KeepTheLevelOverAllLooks) {
  std::mt19937 random(37);
  constexpr int kTimes = 600;
  int apart = 0;
  for (int i = 0; i < kTimes; ++i) apart += LooksTellThemApart(random, 5) ? 1 : 0;
  EXPECT_LE(apart, kTimes * 0.05);
  EXPECT_GE(apart, kTimes * 0.005) << "the looks must be able to decide";
}

TEST(Groups, CountALookWhereBothRowsHaveMoreEpisodes) {
  auto rows = BoardOf({Succeeds(80), Succeeds(74)}, kTiers);
  const auto looks = [&](std::set<int64_t> above, std::set<int64_t> below) {
    rows[0].further = std::move(above);
    rows[1].further = std::move(below);
    return *FormGroups(kTestedMetrics, rows, kTiers, {.further_looks = true}).places[1].above;
  };
  EXPECT_EQ(looks({}, {}).looks, 1);
  EXPECT_EQ(looks({100}, {}).looks, 1);
  EXPECT_EQ(looks({100}, {100}).looks, 2);
  EXPECT_EQ(looks({50, 100}, {100}).looks, 3);
  EXPECT_EQ(looks({200}, {100, 200}).looks, 3);
  // Six episodes differ: 2 * (1/2)^6, which would decide in one look alone.
  EXPECT_DOUBLE_EQ(looks({}, {}).p_adjusted, 0.0625);
  EXPECT_DOUBLE_EQ(FormGroups(kTestedMetrics, rows, kTiers, {}).places[1].above->p_adjusted, 0.03125);
  EXPECT_DOUBLE_EQ(looks({100}, {100}).p_adjusted, 0.125);
}

TEST(Groups, NeedSamplesThatCanDecide) {
  EXPECT_EQ(FewestSamples(0.05, 10), 900);
  EXPECT_EQ(FewestSamples(0.05, 1), 0);
}

TEST(SpreadOverSteps, IsAroundTheMean) {
  const auto episodes =
      Play100([](int64_t i) { return Played{.pain_sum = 20 + Noise(i, 1), .steps = 10}; });
  const Aggregate aggregate = *AggregateEpisodes(kTestedMetrics, episodes);
  const std::optional<Spread> spread = SpreadOverSteps(kTestedMetrics, kPainPlace, episodes);
  ASSERT_TRUE(spread.has_value());
  // Of equal steps it is that of the plain mean of sums, by the steps.
  EXPECT_NEAR(spread->low, aggregate.means[3].spread.low / 10, 1e-12);
  EXPECT_NEAR(spread->high, aggregate.means[3].spread.high / 10, 1e-12);
  EXPECT_FALSE(SpreadOverSteps(kTestedMetrics, kTimePlace, episodes).has_value());
  EXPECT_FALSE(SpreadOverSteps(kTestedMetrics, kPainPlace, {}).has_value());
}

TEST(Groups, PairWhatBothPlayedToAResult) {
  auto rows = BoardOf({Succeeds(80), Succeeds(50)}, kTiers);
  const auto pairs = [&] {
    return FormGroups(kTestedMetrics, rows, kTiers, {}).places[1].above->test.pairs;
  };
  ASSERT_EQ(pairs(), 100);
  rows[0].episodes[3].verdict.outcome = Outcome::kCancelled;
  rows[1].episodes[5].verdict.outcome = Outcome::kGraderError;
  EXPECT_EQ(pairs(), 98);
  rows[0].episodes.erase(rows[0].episodes.begin() + 10);
  rows[1].episodes.erase(rows[1].episodes.begin() + 20, rows[1].episodes.begin() + 22);
  EXPECT_EQ(pairs(), 95);
  rows[1].episodes.pop_back();
  EXPECT_EQ(pairs(), 94);
  rows[0].episodes.erase(rows[0].episodes.begin());
  EXPECT_EQ(pairs(), 93);
  rows[1].episodes.clear();
  EXPECT_EQ(pairs(), 0);
}

TEST(Groups, LeaveOutPairsWithoutANumber) {
  const auto entry = [](double time) {
    return Play100([=](int64_t i) { return Played{.time = time + Noise(i, 0.1)}; });
  };
  auto rows = BoardOf({entry(1), entry(2)}, kTiers);
  rows[0].episodes[3].verdict.metrics[0] = std::nullopt;
  rows[1].episodes[5].verdict.metrics.clear();
  const Groups groups = FormGroups(kTestedMetrics, rows, kTiers, {});
  EXPECT_EQ(groups.places[1].above->criterion, (Criterion{Kind::kNumber, kTimePlace}));
  EXPECT_EQ(groups.places[1].above->test.pairs, 98);
}

TEST(SpreadOverSteps, NeedsTwoEpisodesThatCountAndAStep) {
  const auto spread = [](std::vector<JudgedEpisode> episodes) {
    return SpreadOverSteps(kTestedMetrics, kPainPlace, episodes);
  };
  std::vector<JudgedEpisode> episodes = {EpisodeOf(0, {.pain_sum = 10, .steps = 10}),
                                         EpisodeOf(1, {.pain_sum = 30, .steps = 10})};
  const std::optional<Spread> two = spread(episodes);
  ASSERT_TRUE(two.has_value());
  // Both lie 10 from 2 times their steps: sqrt(200 * 2 / 1) / 20.
  EXPECT_NEAR(two->low, 2 - 1.959963985, 1e-8);
  EXPECT_NEAR(two->high, 2 + 1.959963985, 1e-8);
  EXPECT_NEAR(two->deviation, std::sqrt(2.0), 1e-12);
  episodes.push_back(EpisodeOf(2, {.pain_sum = 1000, .steps = 1}));
  episodes.back().verdict.outcome = Outcome::kGraderError;
  episodes.insert(episodes.begin(), episodes.back());
  EXPECT_EQ(spread(episodes)->high, two->high);
  EXPECT_FALSE(spread({episodes[0], episodes[1]}).has_value()) << "one counts";
  EXPECT_FALSE(spread({EpisodeOf(0, {.steps = 0}), EpisodeOf(1, {.steps = 0})}).has_value());
  EXPECT_TRUE(spread({EpisodeOf(0, {.steps = 0}), EpisodeOf(1, {.steps = 1})}).has_value());
}

TEST(SpreadOverSteps, AnEpisodeWithoutASumAddsItsStepsAlone) {
  std::vector<JudgedEpisode> episodes = {EpisodeOf(0, {.pain_sum = 10, .steps = 10}),
                                         EpisodeOf(1, {.pain_sum = 0, .steps = 30})};
  const std::optional<Spread> with = SpreadOverSteps(kTestedMetrics, kPainPlace, episodes);
  episodes[1].verdict.metrics[3] = std::nullopt;
  const std::optional<Spread> without = SpreadOverSteps(kTestedMetrics, kPainPlace, episodes);
  ASSERT_TRUE(with.has_value() && without.has_value());
  EXPECT_EQ(without->low, with->low);
  EXPECT_EQ(without->high, with->high);
}

RC_GTEST_PROP(GroupsProperties, NeitherOrderOfEpisodesNorLaterRowsMatter, ()) {
  std::vector<std::vector<JudgedEpisode>> all;
  const int entries = *rc::gen::inRange(2, 5);
  for (int entry = 0; entry < entries; ++entry) {
    all.push_back(Play100(
        [](int64_t) {
          return Played{.success = *rc::gen::arbitrary<bool>(),
                        .time = *rc::gen::inRange(1, 9) / 4.0};
        },
        20));
  }
  std::vector<TestedRow> rows = BoardOf(all, kTiers);
  const GroupRules two{.samples = 200, .places = 2};
  const std::vector<int64_t> groups = GroupsOf(rows, kTiers, two);
  for (TestedRow& row : rows) std::reverse(row.episodes.begin(), row.episodes.end());
  rows.resize(2);
  RC_ASSERT(GroupsOf(rows, kTiers, two) == groups);
}

RC_GTEST_PROP(GroupsProperties, GrowByOneAtMost, ()) {
  std::vector<std::vector<JudgedEpisode>> all;
  for (int entry = 0; entry < 6; ++entry) all.push_back(Succeeds(*rc::gen::inRange(0, 100)));
  const std::vector<int64_t> groups = GroupsOf(BoardOf(all, kTiers), kTiers, {.samples = 300});
  RC_ASSERT(groups.front() == 1);
  for (size_t i = 1; i < groups.size(); ++i) {
    RC_ASSERT(groups[i] == groups[i - 1] || groups[i] == groups[i - 1] + 1);
  }
}

}  // namespace
}  // namespace myograde::scoring
