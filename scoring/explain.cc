#include <charconv>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "scoring/board.h"
#include "scoring/groups.h"

namespace myograde::scoring {
namespace {

// The shortest text that reads back as the same number.
std::string Exact(double value) {
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return std::string(buffer, end);
}

// Two values of one metric as texts, with its digits, and with more where they differ and would look alike.
struct Texts {
  std::string above;
  std::string below;
  int digits;
};

std::string Rounded(double value, int digits) { return absl::StrFormat("%.*f", digits, value); }

std::string Rounded(const std::optional<double>& value, int digits) {
  return value.has_value() ? Rounded(*value, digits) : "none";
}

// What a sentence speaks of: the two rows, and how their numbers are written.
class TwoRows {
 public:
  TwoRows(const RankedEntry& above, const RankedEntry& below, std::span<const Metric> metrics)
      : above_(above), below_(below), metrics_(metrics) {}

  const BoardEntry& a() const { return above_.entry; }
  const BoardEntry& b() const { return below_.entry; }
  int64_t band_a() const { return above_.band; }
  int64_t band_b() const { return below_.band; }
  double opener() const { return above_.band_opener; }

  bool Equal(size_t place) const { return a().numbers[place] == b().numbers[place]; }

  Texts Of(size_t place) const {
    const std::optional<double>& above = a().numbers[place];
    const std::optional<double>& below = b().numbers[place];
    int digits = MetricOf(metrics_, place).digits;
    while (above != below && digits < kMostDigits &&
           Rounded(above, digits) == Rounded(below, digits)) {
      ++digits;
    }
    return {Rounded(above, digits), Rounded(below, digits), digits};
  }

 private:
  static constexpr int kMostDigits = 17;

  const RankedEntry& above_;
  const RankedEntry& below_;
  std::span<const Metric> metrics_;
};

std::string Name(const RankedEntry& ranked) {
  return absl::StrCat(ranked.entry.team, ranked.rank == 0 ? " (baseline)"
                                                          : absl::StrCat(" (rank ", ranked.rank, ")"));
}

std::string Successes(const BoardEntry& entry) {
  return absl::StrCat(entry.successes, " of ", entry.episodes);
}

std::string Percent(double rate) { return absl::StrFormat("%g %%", 100 * rate); }

std::string LineOf(const TieredBoard& rules) {
  return Percent(static_cast<double>(rules.line_successes) /
                 static_cast<double>(rules.line_episodes));
}

std::string AcceptedFirst(const std::string& equal, const TwoRows& pair) {
  return absl::StrCat(equal, ", and it was accepted first, as submission ", pair.a().acceptance,
                      " against ", pair.b().acceptance);
}

std::string ByEffort(const std::string& equal, const TwoRows& pair, size_t place) {
  const Texts effort = pair.Of(place);
  if (pair.Equal(place)) {
    return AcceptedFirst(absl::StrCat(equal, ", both efforts are ", effort.above), pair);
  }
  return absl::StrCat(equal, ", and its effort is less, ", effort.above, " against ",
                      effort.below);
}

std::string ByTimeThenEffort(const std::string& equal, const TwoRows& pair,
                             const TieredBoard& rules) {
  const Texts time = pair.Of(rules.time);
  if (pair.Equal(rules.time)) {
    return ByEffort(absl::StrCat(equal, ", both mean times are ", time.above, " s"), pair,
                    rules.effort);
  }
  return absl::StrCat(equal, ", and its mean time is ", time.above, " s against ", time.below,
                      " s");
}

std::string BandsOf(const TwoRows& pair) {
  return absl::StrCat(" (band ", pair.band_a() + 1, " against ", pair.band_b() + 1, ")");
}

std::string WhyInBands(const TwoRows& pair, const TieredBoard& rules) {
  const bool over_time = rules.bands == BandsOver::kTime;
  const std::string factor = Exact(rules.band_factor);
  const Texts time = pair.Of(rules.time);
  const std::string opener =
      over_time ? Rounded(pair.opener(), time.digits) : Percent(pair.opener());
  if (pair.band_a() != pair.band_b()) {
    const std::string numbers =
        over_time ? absl::StrCat("its mean time is ", time.above, " s against ", time.below,
                                 " s, which is more than ", factor, " times the ", opener,
                                 " s that opened its band")
                  : absl::StrCat("it succeeded in ", Successes(pair.a()), " episodes against ",
                                 Successes(pair.b()), ", whose rate times ", factor,
                                 " is less than the ", opener, " that opened its band");
    return numbers + BandsOf(pair);
  }
  const std::string band =
      over_time ? absl::StrCat("both mean times, ", time.above, " s and ", time.below,
                               " s, are at most ", factor, " times the ", opener,
                               " s that opened band ", pair.band_a() + 1)
                : absl::StrCat("both success rates, ", Successes(pair.a()), " and ",
                               Successes(pair.b()), ", times ", factor, " are at least the ",
                               opener, " that opened band ", pair.band_a() + 1);
  return ByEffort(band, pair, rules.effort);
}

std::string Why(const TwoRows& pair, const TieredBoard& rules) {
  const BoardEntry& a = pair.a();
  const BoardEntry& b = pair.b();
  if (pair.band_b() >= 0) return WhyInBands(pair, rules);
  if (pair.band_a() >= 0) {
    return absl::StrCat("it succeeded in ", Successes(a), " episodes, which reaches the line of ",
                        LineOf(rules), ", against ",
                        Successes(b), ", which does not");
  }
  if (!EqualRates(a, b)) {
    return absl::StrCat("it succeeded in ", Successes(a), " episodes against ", Successes(b));
  }
  const std::string equal = absl::StrCat("both succeeded at the same rate, ", Successes(a),
                                         " and ", Successes(b), " episodes");
  if (rules.ties == Ties::kAcceptance) return AcceptedFirst(equal, pair);
  return ByTimeThenEffort(equal, pair, rules);
}

std::string ByTime(const std::string& equal, const TwoRows& pair, const DistanceBoard& rules) {
  const Texts time = pair.Of(rules.time);
  if (!pair.Equal(rules.time)) {
    return absl::StrCat(equal, ", and its mean time is ", time.above, " s against ", time.below,
                        " s");
  }
  const std::string still = absl::StrCat(equal, ", both mean times are ", time.above, " s");
  if (!pair.Equal(rules.distance)) return still + ", and its mean distance is larger";
  return AcceptedFirst(still, pair);
}

std::string Why(const TwoRows& pair, const DistanceBoard& rules) {
  const Texts distance = pair.Of(rules.distance);
  const bool differ = !pair.Equal(rules.distance);
  const std::string equal = absl::StrCat("both mean distances are ", distance.above, " m");
  const std::string farther = absl::StrCat("its mean distance is ", distance.above, " m against ",
                                           distance.below, " m");
  if (pair.band_b() < 0) {  // one of them, or both, did not come as far as time counts
    if (differ) return farther;
    return AcceptedFirst(absl::StrCat(equal, ", less than the ", Exact(rules.time_from_m),
                                      " m from which time decides"),
                         pair);
  }
  if (rules.band == 0) return differ ? farther : ByTime(equal, pair, rules);
  const std::string factor = Exact(1 + rules.band);
  const std::string opener = Rounded(pair.opener(), distance.digits);
  if (pair.band_a() != pair.band_b()) {
    return absl::StrCat(farther, ", which times ", factor, " is less than the ", opener,
                        " m that opened its band") + BandsOf(pair);
  }
  return ByTime(absl::StrCat("both mean distances, ", distance.above, " m and ", distance.below,
                             " m, times ", factor, " are at least the ", opener,
                             " m that opened band ", pair.band_a() + 1),
                pair, rules);
}

std::string Why(const TwoRows& pair, const PhysiologicalBoard& rules) {
  const std::string over = rules.means == MeansOver::kSteps ? " over all steps" : "";
  const Texts pain = pair.Of(rules.pain);
  if (!pair.Equal(rules.pain)) {
    return absl::StrCat("its mean pain", over, " is less, ", pain.above, " against ", pain.below);
  }
  const std::string equal = absl::StrCat("both mean pains", over, " are ", pain.above);
  const Texts effort = pair.Of(rules.effort);
  if (!pair.Equal(rules.effort)) {
    return absl::StrCat(equal, ", and its mean effort is less, ", effort.above, " against ",
                        effort.below);
  }
  return AcceptedFirst(absl::StrCat(equal, ", both mean efforts are ", effort.above), pair);
}

std::string Why(const TwoRows& pair, const ScoreBoard& rules) {
  const Texts score = pair.Of(rules.score);
  if (!pair.Equal(rules.score)) {
    return absl::StrCat("its mean score is ", score.above, " against ", score.below);
  }
  return ByEffort(absl::StrCat("both mean scores are ", score.above), pair, rules.effort);
}

std::string OrderOf(const TieredBoard& rules) {
  const std::string factor = Exact(rules.band_factor);
  const std::string bands =
      rules.bands == BandsOver::kTime
          ? absl::StrCat("mean time (a band holds all up to ", factor, " times its fastest)")
          : absl::StrCat("the success rate (a band holds all whose rate times ", factor,
                         " reaches its best)");
  return absl::StrCat("First those with a success rate of at least ", LineOf(rules), ", in bands of ", bands,
                      " and by less effort within a band. Then the others by successes",
                      rules.ties == Ties::kTime
                          ? ", where these are equal by less mean time, then by less effort."
                          : "; effort does not count below that line.");
}

std::string OrderOf(const DistanceBoard& rules) {
  if (rules.band > 0) {
    return absl::StrCat("By mean distance; from ", Exact(rules.time_from_m),
                        " m on in bands (a band holds all whose distance times ",
                        Exact(1 + rules.band),
                        " reaches its farthest) and by less mean time within a band, then by "
                        "distance. Effort does not count.");
  }
  return absl::StrCat("By mean distance; where it is exactly equal and at least ",
                      Exact(rules.time_from_m), " m, by less mean time. Effort does not count.");
}

std::string OrderOf(const PhysiologicalBoard& rules) {
  return absl::StrCat("Of those with a mean distance of at least ", Exact(rules.qualify_m),
                      " m: by less mean pain, where it is equal by less mean effort, both over ",
                      rules.means == MeansOver::kSteps ? "all steps." : "episodes.");
}

std::string OrderOf(const ScoreBoard&) {
  return "By mean score; where it is exactly equal by less mean effort.";
}

}  // namespace

std::string Explain(const RankedEntry& above, const RankedEntry& below, const BoardRules& rules,
                    std::span<const Metric> metrics) {
  const TwoRows pair(above, below, metrics);
  return absl::StrCat(Name(above), " stands above ", Name(below), ": ",
                      std::visit([&](const auto& kind) { return Why(pair, kind); }, rules), ".");
}

std::string DescribeBand(const RankedEntry& ranked, const BoardRules& rules,
                         std::span<const Metric> metrics) {
  const int64_t number = ranked.band + 1;
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    if (number == 0) {
      return absl::StrCat("Success rates below ", LineOf(*tiered), ": successes decide");
    }
    const std::string factor = Exact(tiered->band_factor);
    if (tiered->bands == BandsOver::kSuccess) {
      return absl::StrCat("Band ", number, ", success rates of at least ",
                          Percent(ranked.band_opener), " / ", factor, ": effort decides");
    }
    const int digits = MetricOf(metrics, tiered->time).digits;
    return absl::StrCat("Band ", number, ", within ", Percent(tiered->band_factor - 1),
                        " of ", number == 1 ? "the" : "its", " fastest, ",
                        Rounded(ranked.band_opener, digits), " s: effort decides");
  }
  const auto* distance = std::get_if<DistanceBoard>(&rules);
  if (distance == nullptr || distance->band == 0) return "";
  if (number == 0) {
    return absl::StrCat("Below ", Exact(distance->time_from_m), " m: distance decides");
  }
  const int digits = MetricOf(metrics, distance->distance).digits;
  return absl::StrCat("Band ", number, ", distances of at least ",
                      Rounded(ranked.band_opener, digits), " m / ", Exact(1 + distance->band),
                      ": time decides");
}

std::string DescribeOrder(const BoardRules& rules) {
  return absl::StrCat(std::visit([](const auto& kind) { return OrderOf(kind); }, rules),
                      " What is equal then stands in the order of acceptance.");
}

}  // namespace myograde::scoring
