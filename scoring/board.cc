#include "scoring/board.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

namespace myograde::scoring {
namespace {

using Ranked = std::vector<RankedEntry>;

// Where less is better, none is the worst.
double Number(const BoardEntry& entry, size_t place) {
  return entry.numbers.at(place).value_or(std::numeric_limits<double>::infinity());
}

double Distance(const BoardEntry& entry, size_t place) {
  return entry.numbers.at(place).value_or(0);
}

// k/n >= k'/n' without rounding.
bool RateAtLeast(const BoardEntry& a, int64_t successes, int64_t episodes) {
  return a.successes * episodes >= successes * a.episodes;
}

bool RateLess(const BoardEntry& a, const BoardEntry& b) {
  return a.successes * b.episodes < b.successes * a.episodes;
}

double Rate(const BoardEntry& entry) {
  return static_cast<double>(entry.successes) / static_cast<double>(entry.episodes);
}

// Sorts by `less`, and where it says neither by acceptance. `less` must be a strict weak order.
template <typename Less>
void SortBy(Ranked::iterator begin, Ranked::iterator end, Less less) {
  std::sort(begin, end, [&](const RankedEntry& a, const RankedEntry& b) {
    if (less(a.entry, b.entry)) return true;
    if (less(b.entry, a.entry)) return false;
    return a.entry.acceptance < b.entry.acceptance;
  });
}

bool HigherRate(const BoardEntry& a, const BoardEntry& b) { return RateLess(b, a); }

// The order by a number of which less is better.
auto LessOf(size_t place) {
  return [place](const BoardEntry& a, const BoardEntry& b) {
    return Number(a, place) < Number(b, place);
  };
}

// Cuts [begin, end), sorted by what the bands are made of, into bands and sorts each by `less`.
// `value` is what opens a band, `belongs` whether another value belongs to the band of it.
template <typename Value, typename Belongs, typename Less>
void SortIntoBands(Ranked::iterator begin, Ranked::iterator end, Value value, Belongs belongs,
                   Less less) {
  int64_t band = 0;
  while (begin != end) {
    const double opener = value(begin->entry);
    // The opener belongs to its band whatever the factor's rounding does.
    auto band_end = std::next(begin);
    while (band_end != end && belongs(value(band_end->entry), opener)) ++band_end;
    for (auto it = begin; it != band_end; ++it) {
      it->band = band;
      it->band_opener = opener;
    }
    SortBy(begin, band_end, less);
    begin = band_end;
    ++band;
  }
}

void Order(Ranked& board, const TieredBoard& rules) {
  const auto faster = LessOf(rules.time);
  const auto less_effort = LessOf(rules.effort);
  const auto line = std::partition(board.begin(), board.end(), [&](const RankedEntry& ranked) {
    return RateAtLeast(ranked.entry, rules.line_successes, rules.line_episodes);
  });
  if (rules.bands == BandsOver::kTime) {
    SortBy(board.begin(), line, faster);
    SortIntoBands(
        board.begin(), line, [&](const BoardEntry& entry) { return Number(entry, rules.time); },
        [&](double time, double opener) { return time <= rules.band_factor * opener; },
        less_effort);
  } else {
    SortBy(board.begin(), line, HigherRate);
    SortIntoBands(
        board.begin(), line, Rate,
        [&](double rate, double opener) { return rules.band_factor * rate >= opener; },
        less_effort);
  }
  SortBy(line, board.end(), [&](const BoardEntry& a, const BoardEntry& b) {
    if (HigherRate(a, b) || HigherRate(b, a)) return HigherRate(a, b);
    if (rules.ties == Ties::kAcceptance) return false;
    if (faster(a, b) || faster(b, a)) return faster(a, b);
    return less_effort(a, b);
  });
}

void Order(Ranked& board, const DistanceBoard& rules) {
  const auto distance = [&](const BoardEntry& entry) { return Distance(entry, rules.distance); };
  const auto farther = [&](const BoardEntry& a, const BoardEntry& b) {
    return distance(a) > distance(b);
  };
  const auto faster = LessOf(rules.time);
  SortBy(board.begin(), board.end(), farther);
  const auto line = std::partition_point(board.begin(), board.end(), [&](const auto& ranked) {
    return distance(ranked.entry) >= rules.time_from_m;
  });
  SortIntoBands(
      board.begin(), line, distance,
      [&](double value, double opener) { return value * (1 + rules.band) >= opener; },
      [&](const BoardEntry& a, const BoardEntry& b) {
        if (faster(a, b) || faster(b, a)) return faster(a, b);
        return farther(a, b);
      });
}

void Order(Ranked& board, const PhysiologicalBoard& rules) {
  std::erase_if(board, [&](const RankedEntry& ranked) {
    return Distance(ranked.entry, rules.distance) < rules.qualify_m;
  });
  const auto numbers = [&](const BoardEntry& entry) {
    return std::pair(Number(entry, rules.pain), Number(entry, rules.effort));
  };
  SortBy(board.begin(), board.end(), [&](const BoardEntry& a, const BoardEntry& b) {
    return numbers(a) < numbers(b);
  });
}

Ranked Ordered(Ranked board, const BoardRules& rules) {
  std::visit([&](const auto& kind) { Order(board, kind); }, rules);
  for (size_t i = 0; i < board.size(); ++i) board[i].rank = static_cast<int64_t>(i) + 1;
  return board;
}

// The submission that a team stands with, out of all of its own.
std::optional<RankedEntry> Standing(const Ranked& own, const BoardRules& rules, TeamRule rule) {
  if (rule == TeamRule::kBest) {
    const Ranked ordered = Ordered(own, rules);
    if (ordered.empty()) return std::nullopt;
    return RankedEntry{ordered.front().entry};
  }
  std::optional<RankedEntry> standing;
  for (const RankedEntry& candidate : own) {
    if (rule == TeamRule::kChosen && !candidate.entry.chosen) continue;
    if (!standing || standing->entry.acceptance < candidate.entry.acceptance) {
      standing = candidate;
    }
  }
  return standing;
}

// How many numbers the board looks at.
size_t PlacesOf(const BoardRules& rules) {
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    return std::max(tiered->time, tiered->effort) + 1;
  }
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) {
    return std::max(distance->distance, distance->time) + 1;
  }
  const auto& body = std::get<PhysiologicalBoard>(rules);
  return std::max({body.distance, body.pain, body.effort}) + 1;
}

absl::Status Check(const BoardEntry& entry, const BoardRules& rules) {
  if (entry.numbers.size() < PlacesOf(rules)) {
    return absl::InvalidArgumentError(absl::StrCat("submission ", entry.submission, ": has ",
                                                   entry.numbers.size(),
                                                   " numbers, and the board ranks by more"));
  }
  for (const std::optional<double>& number : entry.numbers) {
    if (number.has_value() && !std::isfinite(*number)) {
      return absl::InvalidArgumentError(
          absl::StrCat("submission ", entry.submission, ": a mean is not a finite number"));
    }
  }
  if (entry.episodes < 1 || entry.successes < 0 || entry.successes > entry.episodes) {
    return absl::InvalidArgumentError(absl::StrCat("submission ", entry.submission, ": ",
                                                   entry.successes, " successes in ",
                                                   entry.episodes, " episodes can't be"));
  }
  return absl::OkStatus();
}

}  // namespace

BoardEntry MakeEntry(std::span<const Metric> metrics, const Aggregate& aggregate) {
  BoardEntry entry;
  entry.failed = aggregate.failed;
  entry.successes = aggregate.successes;
  entry.episodes = aggregate.episodes;
  for (size_t i = 0; i < metrics.size(); ++i) {
    if (!metrics[i].ranked) continue;
    const Mean& mean = aggregate.means[i];
    entry.numbers.push_back(mean.count == 0 ? std::nullopt : std::optional(mean.value));
  }
  return entry;
}

bool IsQualified(const BoardEntry& entry, const BoardRules& rules) {
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    return RateAtLeast(entry, tiered->line_successes, tiered->line_episodes);
  }
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) {
    return Distance(entry, distance->distance) >= distance->time_from_m;
  }
  const auto& body = std::get<PhysiologicalBoard>(rules);
  return Distance(entry, body.distance) >= body.qualify_m;
}

absl::StatusOr<std::vector<RankedEntry>> Rank(const std::vector<BoardEntry>& entries,
                                              const BoardRules& rules, TeamRule team_rule) {
  std::map<std::string, Ranked> teams;
  std::set<int64_t> acceptances;
  for (const BoardEntry& entry : entries) {
    if (!acceptances.insert(entry.acceptance).second) {
      return absl::InvalidArgumentError(absl::StrCat("submission ", entry.submission,
                                                     ": its acceptance number ", entry.acceptance,
                                                     " is another's too"));
    }
    if (entry.failed) continue;
    if (absl::Status status = Check(entry, rules); !status.ok()) return status;
    teams[entry.team].push_back(RankedEntry{entry});
  }
  Ranked board;
  for (const auto& [team, own] : teams) {
    if (auto standing = Standing(own, rules, team_rule)) board.push_back(*std::move(standing));
  }
  return Ordered(std::move(board), rules);
}

}  // namespace myograde::scoring
