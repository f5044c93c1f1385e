#include <charconv>

#include <absl/strings/str_cat.h>

#include "scoring/board.h"

namespace myograde::scoring {
namespace {

// The shortest text that reads back as the same number.
std::string Exact(double value) {
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return std::string(buffer, end);
}

std::string Exact(const std::optional<double>& value) {
  return value.has_value() ? Exact(*value) : "none";
}

std::string Name(const RankedEntry& ranked) {
  return absl::StrCat(ranked.entry.submission, " (", ranked.entry.team, ")");
}

std::string Successes(const BoardEntry& entry) {
  return absl::StrCat(entry.successes, " of ", entry.episodes);
}

bool SameRate(const BoardEntry& a, const BoardEntry& b) {
  return a.successes * b.episodes == b.successes * a.episodes;
}

// "X stands above Y" and the rest of the sentence.
std::string Sentence(const RankedEntry& above, const RankedEntry& below, const std::string& why) {
  return absl::StrCat(Name(above), " stands above ", Name(below), ": ", why, ".");
}

std::string AcceptedFirst(const std::string& equal, const BoardEntry& above,
                          const BoardEntry& below) {
  return absl::StrCat(equal, ", and it was accepted first, as number ", above.acceptance,
                      " against ", below.acceptance);
}

std::string ByEffort(const std::string& equal, const BoardEntry& a, const BoardEntry& b,
                     size_t place) {
  const std::optional<double>& effort = a.numbers[place];
  if (effort != b.numbers[place]) {
    return absl::StrCat(equal, ", and its effort is less, ", Exact(effort), " against ",
                        Exact(b.numbers[place]));
  }
  return AcceptedFirst(absl::StrCat(equal, ", both efforts are ", Exact(effort)), a, b);
}

std::string ByTimeThenEffort(const std::string& equal, const BoardEntry& a, const BoardEntry& b,
                             const TieredBoard& rules) {
  const std::optional<double>& time = a.numbers[rules.time];
  if (time != b.numbers[rules.time]) {
    return absl::StrCat(equal, ", and its mean time is ", Exact(time), " s against ",
                        Exact(b.numbers[rules.time]), " s");
  }
  return ByEffort(absl::StrCat(equal, ", both mean times are ", Exact(time), " s"), a, b,
                  rules.effort);
}

std::string WhyInBands(const RankedEntry& above, const RankedEntry& below,
                       const TieredBoard& rules) {
  const bool over_time = rules.bands == BandsOver::kTime;
  const std::string factor = Exact(rules.band_factor);
  const std::string opener = Exact(above.band_opener);
  const BoardEntry& a = above.entry;
  const BoardEntry& b = below.entry;
  const std::string time_a = Exact(a.numbers[rules.time]);
  const std::string time_b = Exact(b.numbers[rules.time]);
  if (above.band != below.band) {
    const std::string numbers =
        over_time ? absl::StrCat("its mean time is ", time_a, " s against ", time_b,
                                 " s, which is more than ", factor, " times the ", opener,
                                 " s that opened its band")
                  : absl::StrCat("it succeeded in ", Successes(a), " episodes against ",
                                 Successes(b), ", whose rate times ", factor, " is less than the ",
                                 opener, " that opened its band");
    return absl::StrCat(numbers, " (band ", above.band + 1, " against ", below.band + 1, ")");
  }
  const std::string band =
      over_time ? absl::StrCat("both mean times, ", time_a, " s and ", time_b,
                               " s, are at most ", factor, " times the ", opener,
                               " s that opened band ", above.band + 1)
                : absl::StrCat("both success rates, ", Successes(a), " and ", Successes(b),
                               ", times ", factor, " are at least the ", opener,
                               " that opened band ", above.band + 1);
  return ByEffort(band, a, b, rules.effort);
}

std::string Why(const RankedEntry& above, const RankedEntry& below, const TieredBoard& rules) {
  const BoardEntry& a = above.entry;
  const BoardEntry& b = below.entry;
  if (below.band >= 0) return WhyInBands(above, below, rules);
  if (above.band >= 0) {
    return absl::StrCat("it succeeded in ", Successes(a), " episodes, which reaches the line of ",
                        rules.line_successes, " of ", rules.line_episodes, ", against ",
                        Successes(b), ", which does not");
  }
  if (!SameRate(a, b)) {
    return absl::StrCat("it succeeded in ", Successes(a), " episodes against ", Successes(b));
  }
  const std::string equal = absl::StrCat("both succeeded at the same rate, ", Successes(a),
                                         " and ", Successes(b), " episodes");
  if (rules.ties == Ties::kAcceptance) return AcceptedFirst(equal, a, b);
  return ByTimeThenEffort(equal, a, b, rules);
}

std::string ByTime(const std::string& equal, const BoardEntry& a, const BoardEntry& b,
                   const DistanceBoard& rules) {
  if (a.numbers[rules.time] != b.numbers[rules.time]) {
    return absl::StrCat(equal, ", and its mean time is ", Exact(a.numbers[rules.time]),
                        " s against ", Exact(b.numbers[rules.time]), " s");
  }
  const std::string still =
      absl::StrCat(equal, ", both mean times are ", Exact(a.numbers[rules.time]), " s");
  if (a.numbers[rules.distance] != b.numbers[rules.distance]) {
    return absl::StrCat(still, ", and its mean distance is larger");
  }
  return AcceptedFirst(still, a, b);
}

std::string Why(const RankedEntry& above, const RankedEntry& below, const DistanceBoard& rules) {
  const BoardEntry& a = above.entry;
  const BoardEntry& b = below.entry;
  const std::string distance_a = Exact(a.numbers[rules.distance]);
  const std::string distance_b = Exact(b.numbers[rules.distance]);
  const std::string equal = absl::StrCat("both mean distances are ", distance_a, " m");
  const std::string farther = absl::StrCat("its mean distance is ", distance_a,
                                           " m against ", distance_b, " m");
  if (below.band < 0) {  // one of them, or both, did not come as far as time counts
    if (a.numbers[rules.distance] != b.numbers[rules.distance]) return farther;
    return AcceptedFirst(absl::StrCat(equal, ", less than the ", Exact(rules.time_from_m),
                                      " m from which time decides"),
                         a, b);
  }
  if (rules.band == 0) {
    const bool differ = a.numbers[rules.distance] != b.numbers[rules.distance];
    return differ ? farther : ByTime(equal, a, b, rules);
  }
  const std::string factor = Exact(1 + rules.band);
  const std::string opener = Exact(above.band_opener);
  if (above.band != below.band) {
    return absl::StrCat(farther, ", which times ", factor, " is less than the ", opener,
                        " m that opened its band (band ", above.band + 1, " against ",
                        below.band + 1, ")");
  }
  return ByTime(absl::StrCat("both mean distances, ", distance_a, " m and ",
                             distance_b, " m, times ", factor, " are at least the ",
                             opener, " m that opened band ", above.band + 1),
                a, b, rules);
}

std::string Why(const RankedEntry& above, const RankedEntry& below,
                const PhysiologicalBoard& rules) {
  const bool steps = rules.means == MeansOver::kSteps;
  const auto pain = [&](const RankedEntry& ranked) { return ranked.entry.numbers[rules.pain]; };
  const auto effort = [&](const RankedEntry& ranked) {
    return ranked.entry.numbers[rules.effort];
  };
  const std::string over = steps ? " over all steps" : "";
  if (pain(above) != pain(below)) {
    return absl::StrCat("its mean pain", over, " is less, ", Exact(pain(above)), " against ",
                        Exact(pain(below)));
  }
  const std::string equal = absl::StrCat("both mean pains", over, " are ", Exact(pain(above)));
  if (effort(above) != effort(below)) {
    return absl::StrCat(equal, ", and its mean effort is less, ", Exact(effort(above)),
                        " against ", Exact(effort(below)));
  }
  return AcceptedFirst(absl::StrCat(equal, ", both mean efforts are ", Exact(effort(above))),
                       above.entry, below.entry);
}

std::string OrderOf(const TieredBoard& rules) {
  const std::string factor = Exact(rules.band_factor);
  const std::string bands =
      rules.bands == BandsOver::kTime
          ? absl::StrCat("mean time (a band holds all up to ", factor, " times its fastest)")
          : absl::StrCat("the success rate (a band holds all whose rate times ", factor,
                         " reaches its best)");
  return absl::StrCat("First those with at least ", rules.line_successes, " of ",
                      rules.line_episodes, " successes, in bands of ", bands,
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

}  // namespace

std::string Explain(const RankedEntry& above, const RankedEntry& below, const BoardRules& rules) {
  return std::visit(
      [&](const auto& kind) { return Sentence(above, below, Why(above, below, kind)); }, rules);
}

std::string DescribeOrder(const BoardRules& rules) {
  return absl::StrCat(std::visit([](const auto& kind) { return OrderOf(kind); }, rules),
                      " What is equal then stands in the order of acceptance.");
}

}  // namespace myograde::scoring
