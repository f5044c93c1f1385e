#include "scoring/groups.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

namespace myograde::scoring {
namespace {

using Kind = Criterion::Kind;

Criterion ByNumber(size_t place) { return {Kind::kNumber, place}; }

// The first of `places` whose numbers differ.
Criterion FirstOf(const BoardEntry& a, const BoardEntry& b, std::initializer_list<size_t> places) {
  for (const size_t place : places) {
    if (a.numbers.at(place) != b.numbers.at(place)) return ByNumber(place);
  }
  return {Kind::kAcceptance};
}

Criterion Deciding(const RankedEntry& above, const RankedEntry& below, const TieredBoard& rules) {
  const BoardEntry& a = above.entry;
  const BoardEntry& b = below.entry;
  if (above.band >= 0 && below.band >= 0) {
    if (above.band == below.band) return FirstOf(a, b, {rules.effort});
    return rules.bands == BandsOver::kTime ? ByNumber(rules.time) : Criterion{Kind::kSuccess};
  }
  if (above.band != below.band || !EqualRates(a, b)) return {Kind::kSuccess};
  if (rules.ties == Ties::kAcceptance) return {Kind::kAcceptance};
  return FirstOf(a, b, {rules.time, rules.effort});
}

Criterion Deciding(const RankedEntry& above, const RankedEntry& below,
                   const DistanceBoard& rules) {
  if (below.band < 0 || above.band != below.band) {
    return FirstOf(above.entry, below.entry, {rules.distance});
  }
  return FirstOf(above.entry, below.entry, {rules.time, rules.distance});
}

Criterion Deciding(const RankedEntry& above, const RankedEntry& below,
                   const PhysiologicalBoard& rules) {
  return FirstOf(above.entry, below.entry, {rules.pain, rules.effort});
}

Criterion Deciding(const RankedEntry& above, const RankedEntry& below, const ScoreBoard& rules) {
  return FirstOf(above.entry, below.entry, {rules.score, rules.effort});
}

size_t PlaceOfMetric(std::span<const Metric> metrics, std::string_view name) {
  const auto it = std::find_if(metrics.begin(), metrics.end(),
                               [&](const Metric& metric) { return metric.name == name; });
  return static_cast<size_t>(it - metrics.begin());
}

std::optional<double> ValueAt(const JudgedEpisode& episode, size_t metric) {
  const auto& values = episode.verdict.metrics;
  return metric < values.size() ? values[metric] : std::nullopt;
}

// What a criterion has of an episode, as AggregateEpisodes would sum it.
class Sampler {
 public:
  Sampler(std::span<const Metric> metrics, const Criterion& criterion) : kind_(criterion.kind) {
    if (kind_ != Kind::kNumber) return;
    const Metric& metric = MetricOf(metrics, criterion.number);
    over_steps_ = metric.source == Metric::Source::kOverSteps;
    metric_ = PlaceOfMetric(metrics, over_steps_ ? metric.of : metric.name);
  }

  std::optional<Sample> Of(const JudgedEpisode& episode) const {
    if (kind_ == Kind::kAcceptance) return std::nullopt;
    if (kind_ == Kind::kSuccess) {
      return Sample{episode.verdict.outcome == Outcome::kSuccess ? 1.0 : 0.0};
    }
    const std::optional<double> value = ValueAt(episode, metric_);
    if (over_steps_) return Sample{value.value_or(0), static_cast<double>(episode.verdict.steps)};
    return value.has_value() ? std::optional(Sample{*value}) : std::nullopt;
  }

 private:
  Kind kind_;
  bool over_steps_ = false;
  size_t metric_ = 0;
};

bool Counts(const JudgedEpisode& episode) {
  const Outcome outcome = episode.verdict.outcome;
  return outcome != Outcome::kCancelled && outcome != Outcome::kGraderError;
}

// Both by index.
std::vector<Pair> MakePairs(const Sampler& sampler, const std::vector<JudgedEpisode>& above,
                            const std::vector<JudgedEpisode>& below) {
  std::vector<Pair> pairs;
  auto b = below.begin();
  for (const JudgedEpisode& a : above) {
    while (b != below.end() && b->index < a.index) ++b;
    if (b == below.end()) break;
    if (b->index != a.index || !Counts(a) || !Counts(*b)) continue;
    const std::optional<Sample> sample_a = sampler.Of(a);
    const std::optional<Sample> sample_b = sampler.Of(*b);
    if (sample_a.has_value() && sample_b.has_value()) pairs.push_back({*sample_a, *sample_b});
  }
  return pairs;
}

// Positive if the upper row is ahead.
double AheadOf(std::span<const Metric> metrics, const PlaceTest& test) {
  const bool less = test.criterion.kind == Kind::kNumber &&
                    MetricOf(metrics, test.criterion.number).better == Better::kLess;
  return less ? -test.test.difference : test.test.difference;
}

// The first look is that without further episodes; each number of them that both rows have reached
// is another one.
int64_t LooksAt(const std::set<int64_t>& a, const std::set<int64_t>& b) {
  std::set<int64_t> looks = a;
  looks.insert(b.begin(), b.end());
  const int64_t both = std::min(a.empty() ? 0 : *a.rbegin(), b.empty() ? 0 : *b.rbegin());
  return 1 + std::distance(looks.begin(), looks.upper_bound(both));
}

// The tests of all pairs of rows.
class PairTests {
 public:
  PairTests(std::span<const Metric> metrics, std::span<const TestedRow> rows,
            const BoardRules& rules, const GroupRules& group_rules,
            const std::function<bool()>& stopped)
      : rows_(rows.size()) {
    std::vector<std::vector<JudgedEpisode>> episodes;
    for (const TestedRow& row : rows) {
      episodes.push_back(row.episodes);
      std::sort(episodes.back().begin(), episodes.back().end(),
                [](const auto& a, const auto& b) { return a.index < b.index; });
    }
    for (size_t below = 1; below < rows_; ++below) {
      for (size_t above = 0; above < below; ++above) {
        stopped_ = stopped != nullptr && stopped();
        if (stopped_) return;
        PlaceTest own;
        own.criterion = CriterionOf(rows[above].ranked, rows[below].ranked, rules);
        const Sampler sampler(metrics, own.criterion);
        own.test =
            TestPairs(MakePairs(sampler, episodes[above], episodes[below]), group_rules.samples);
        own.looks = LooksAt(rows[above].further, rows[below].further);
        own.p_adjusted = own.test.p;
        if (group_rules.further_looks) {
          own.p_adjusted = std::min(1.0, std::ldexp(own.test.p, static_cast<int>(own.looks)));
        }
        tests_.push_back(own);
      }
    }
    Correct();
    for (PlaceTest& test : tests_) {
      const double ahead = AheadOf(metrics, test);
      const bool differ = test.p_adjusted <= group_rules.level;
      test.decided = differ && ahead > 0;
      test.reversed = differ && ahead < 0;
    }
  }

  // REQUIRES: above < below.
  const PlaceTest& Of(size_t above, size_t below) const {
    return tests_.at(below * (below - 1) / 2 + above);
  }
  int64_t count() const { return std::ssize(tests_); }
  bool stopped() const { return stopped_; }

 private:
  // Holm's, of what `p_adjusted` has: the smallest p-value times the number of tests, the next one times one less, and none
  // smaller than the one before.
  void Correct() {
    std::vector<size_t> order(tests_.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return tests_[a].p_adjusted < tests_[b].p_adjusted; });
    double least = 0;
    for (size_t i = 0; i < order.size(); ++i) {
      PlaceTest& own = tests_[order[i]];
      least = std::max(least, own.p_adjusted * static_cast<double>(order.size() - i));
      own.p_adjusted = std::min(least, 1.0);
    }
  }

  size_t rows_;
  std::vector<PlaceTest> tests_;
  bool stopped_ = false;
};

}  // namespace

int64_t FewestSamples(double level, int64_t places) {
  const double tests = static_cast<double>(places) * static_cast<double>(places - 1) / 2;
  return static_cast<int64_t>(std::ceil(tests / level));
}

Criterion CriterionOf(const RankedEntry& above, const RankedEntry& below,
                      const BoardRules& rules) {
  return std::visit([&](const auto& kind) { return Deciding(above, below, kind); }, rules);
}

Criterion CriterionWithin(const RankedEntry& ranked, const BoardRules& rules) {
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    return ranked.band >= 0 ? ByNumber(tiered->effort) : Criterion{Kind::kSuccess};
  }
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) {
    const bool in_band = ranked.band >= 0 && distance->band > 0;
    return ByNumber(in_band ? distance->time : distance->distance);
  }
  if (const auto* score = std::get_if<ScoreBoard>(&rules)) return ByNumber(score->score);
  return ByNumber(std::get<PhysiologicalBoard>(rules).pain);
}

Groups FormGroups(std::span<const Metric> metrics, std::span<const TestedRow> rows,
                  const BoardRules& rules, const GroupRules& group_rules,
                  const std::function<bool()>& stopped) {
  rows = rows.first(std::min(rows.size(), static_cast<size_t>(group_rules.places)));
  const PairTests tests(metrics, rows, rules, group_rules, stopped);
  if (tests.stopped()) return {.places = {}, .tests = 0, .stopped = true};
  Groups groups{.places = {}, .tests = tests.count()};
  size_t opener = 0;
  int64_t group = 1;
  for (size_t i = 0; i < rows.size(); ++i) {
    PlaceInGroup place;
    if (i > 0) {
      place.above = tests.Of(i - 1, i);
      place.opener = tests.Of(opener, i);
      place.opened_by = opener;
      if (place.opener->decided) {
        opener = i;
        ++group;
      }
    }
    place.group = group;
    groups.places.push_back(place);
  }
  return groups;
}

std::vector<Criterion> ListCriteria(const BoardRules& rules) {
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    return {{Kind::kSuccess}, ByNumber(tiered->time), ByNumber(tiered->effort)};
  }
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) {
    return {ByNumber(distance->distance), ByNumber(distance->time)};
  }
  if (const auto* score = std::get_if<ScoreBoard>(&rules)) {
    return {ByNumber(score->score), ByNumber(score->effort)};
  }
  const auto& body = std::get<PhysiologicalBoard>(rules);
  return {ByNumber(body.pain), ByNumber(body.effort)};
}

const Metric& MetricOf(std::span<const Metric> metrics, size_t number) {
  const auto it = std::find_if(metrics.begin(), metrics.end(), [&](const Metric& metric) {
    return metric.ranked && number-- == 0;
  });
  return *it;
}

std::optional<Spread> SpreadOverSteps(std::span<const Metric> metrics, size_t number,
                                      std::span<const JudgedEpisode> episodes) {
  constexpr double kHalfWidthOfRatio = 1.959963984540054;  // of a 95 % interval, in errors
  const Metric& metric = MetricOf(metrics, number);
  if (metric.source != Metric::Source::kOverSteps) return std::nullopt;
  const Sampler sampler(metrics, ByNumber(number));
  std::vector<Sample> samples;
  Sample sum{.amount = 0, .weight = 0};
  for (const JudgedEpisode& episode : episodes) {
    if (!Counts(episode)) continue;
    samples.push_back(*sampler.Of(episode));
    sum.amount += samples.back().amount;
    sum.weight += samples.back().weight;
  }
  if (samples.size() < 2 || sum.weight <= 0) return std::nullopt;
  const double ratio = sum.amount / sum.weight;
  double squares = 0;
  for (const Sample& own : samples) squares += std::pow(own.amount - ratio * own.weight, 2);
  const double n = static_cast<double>(samples.size());
  const double error = std::sqrt(squares * n / (n - 1)) / sum.weight;
  return Spread{.deviation = error * std::sqrt(n),
                .low = ratio - kHalfWidthOfRatio * error,
                .high = ratio + kHalfWidthOfRatio * error};
}

}  // namespace myograde::scoring
