#include "scoring/board.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "scoring/standing.h"

namespace myograde::scoring {
namespace {

using Ranked = std::vector<RankedEntry>;

// Where less is better, none is the worst.
double Number(const BoardEntry& entry, size_t place) {
  return entry.numbers.at(place).value_or(std::numeric_limits<double>::infinity());
}

// Where more is better, none is the worst.
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

// How the part of a board at or above its line is ordered.
struct Banding {
  std::function<bool(const BoardEntry&)> takes_part;
  std::function<bool(const BoardEntry&, const BoardEntry&)> before;  // in the order of cutting bands
  std::function<double(const BoardEntry&)> value;                    // what opens a band
  std::function<bool(double, double)> belongs;  // a value, to the band of an opener
  std::function<bool(const BoardEntry&, const BoardEntry&)> inside;  // above, in a band
};

Banding MakeBanding(const TieredBoard& rules) {
  Banding banding;
  banding.takes_part = [rules](const BoardEntry& entry) {
    return RateAtLeast(entry, rules.line_successes, rules.line_episodes);
  };
  banding.inside = LessOf(rules.effort);
  if (rules.bands == BandsOver::kTime) {
    banding.before = LessOf(rules.time);
    banding.value = [rules](const BoardEntry& entry) { return Number(entry, rules.time); };
    banding.belongs = [rules](double time, double opener) {
      return time <= rules.band_factor * opener;
    };
  } else {
    banding.before = HigherRate;
    banding.value = Rate;
    banding.belongs = [rules](double rate, double opener) {
      return rules.band_factor * rate >= opener;
    };
  }
  return banding;
}

Banding MakeBanding(const DistanceBoard& rules) {
  Banding banding;
  const auto distance = [rules](const BoardEntry& entry) { return Distance(entry, rules.distance); };
  banding.takes_part = [rules, distance](const BoardEntry& entry) {
    return distance(entry) >= rules.time_from_m;
  };
  banding.before = [distance](const BoardEntry& a, const BoardEntry& b) {
    return distance(a) > distance(b);
  };
  banding.value = distance;
  banding.belongs = [rules](double value, double opener) {
    return value * (1 + rules.band) >= opener;
  };
  banding.inside = [faster = LessOf(rules.time), farther = banding.before](const BoardEntry& a,
                                                                          const BoardEntry& b) {
    if (faster(a, b) || faster(b, a)) return faster(a, b);
    return farther(a, b);
  };
  return banding;
}

// Sorts those that take part in bands, and returns where they end.
Ranked::iterator SortIntoBands(Ranked& board, const Banding& banding) {
  const auto end = std::partition(board.begin(), board.end(), [&](const RankedEntry& ranked) {
    return banding.takes_part(ranked.entry);
  });
  SortBy(board.begin(), end, banding.before);
  int64_t band = 0;
  for (auto begin = board.begin(); begin != end; ++band) {
    const double opener = banding.value(begin->entry);
    // The opener belongs to its band whatever the factor's rounding does.
    auto band_end = std::next(begin);
    while (band_end != end && banding.belongs(banding.value(band_end->entry), opener)) ++band_end;
    for (auto it = begin; it != band_end; ++it) {
      it->band = band;
      it->band_opener = opener;
    }
    SortBy(begin, band_end, banding.inside);
    begin = band_end;
  }
  return end;
}

void Order(Ranked& board, const TieredBoard& rules) {
  const auto faster = LessOf(rules.time);
  const auto less_effort = LessOf(rules.effort);
  SortBy(SortIntoBands(board, MakeBanding(rules)), board.end(),
         [&](const BoardEntry& a, const BoardEntry& b) {
           if (HigherRate(a, b) || HigherRate(b, a)) return HigherRate(a, b);
           if (rules.ties == Ties::kAcceptance) return false;
           if (faster(a, b) || faster(b, a)) return faster(a, b);
           return less_effort(a, b);
         });
}

void Order(Ranked& board, const DistanceBoard& rules) {
  const Banding banding = MakeBanding(rules);
  SortBy(SortIntoBands(board, banding), board.end(), banding.before);
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

void Order(Ranked& board, const ScoreBoard& rules) {
  const auto numbers = [&](const BoardEntry& entry) {
    return std::pair(-Distance(entry, rules.score), Number(entry, rules.effort));
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

// By team, all of its submissions.
using Teams = std::map<std::string, Ranked>;

// Where nobody's bands depend on others, or a team has nothing that takes part in them.
void AddFirstOfOwn(const Ranked& own, const BoardRules& rules, Ranked& board) {
  const Ranked ordered = Ordered(own, rules);
  if (!ordered.empty()) board.push_back(RankedEntry{ordered.front().entry});
}

// Of teams with submissions that take part in bands, those that they stand with (standing.h).
void AddStanding(const Ranked& candidates, const Banding& banding, Ranked& board) {
  Ranked by_inside = candidates;
  SortBy(by_inside.begin(), by_inside.end(), banding.inside);
  std::map<int64_t, size_t> inside;
  for (const RankedEntry& ranked : by_inside) inside.emplace(ranked.entry.acceptance, inside.size());
  Ranked sorted = candidates;
  SortBy(sorted.begin(), sorted.end(), banding.before);
  std::map<std::string, size_t> teams;
  std::vector<BandCandidate> cut;
  for (const RankedEntry& ranked : sorted) {
    const BoardEntry& entry = ranked.entry;
    cut.push_back({.team = teams.emplace(entry.team, teams.size()).first->second,
                   .acceptance = entry.acceptance,
                   .value = banding.value(entry),
                   .inside = inside.at(entry.acceptance)});
  }
  for (const size_t place : StandingEntries(cut, banding.belongs)) {
    board.push_back(RankedEntry{sorted[place].entry});
  }
}

Ranked BestOf(const Teams& teams, const BoardRules& rules) {
  std::optional<Banding> banding;
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) banding = MakeBanding(*tiered);
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) banding = MakeBanding(*distance);
  Ranked board, candidates;
  for (const auto& [team, own] : teams) {
    const auto known = std::ssize(candidates);
    if (banding) {
      std::copy_if(own.begin(), own.end(), std::back_inserter(candidates),
                   [&](const RankedEntry& ranked) { return banding->takes_part(ranked.entry); });
    }
    if (std::ssize(candidates) == known) AddFirstOfOwn(own, rules, board);
  }
  if (banding) AddStanding(candidates, *banding, board);
  return board;
}

// By a rule that looks at no results: a team's last submission, or its chosen one.
Ranked LastOf(const Teams& teams, bool chosen) {
  Ranked board;
  for (const auto& [team, own] : teams) {
    const RankedEntry* standing = nullptr;
    for (const RankedEntry& candidate : own) {
      if (chosen && !candidate.entry.chosen) continue;
      if (standing == nullptr || standing->entry.acceptance < candidate.entry.acceptance) {
        standing = &candidate;
      }
    }
    if (standing != nullptr) board.push_back(*standing);
  }
  return board;
}

// How many numbers the board looks at.
size_t PlacesOf(const BoardRules& rules) {
  if (const auto* tiered = std::get_if<TieredBoard>(&rules)) {
    return std::max(tiered->time, tiered->effort) + 1;
  }
  if (const auto* distance = std::get_if<DistanceBoard>(&rules)) {
    return std::max(distance->distance, distance->time) + 1;
  }
  if (const auto* score = std::get_if<ScoreBoard>(&rules)) {
    return std::max(score->score, score->effort) + 1;
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

bool EqualRates(const BoardEntry& a, const BoardEntry& b) {
  return a.successes * b.episodes == b.successes * a.episodes;
}

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
  if (std::holds_alternative<ScoreBoard>(rules)) return true;
  const auto& body = std::get<PhysiologicalBoard>(rules);
  return Distance(entry, body.distance) >= body.qualify_m;
}

absl::StatusOr<std::vector<RankedEntry>> Rank(const std::vector<BoardEntry>& entries,
                                              const BoardRules& rules, TeamRule team_rule) {
  Teams teams;
  std::set<int64_t> acceptances;
  for (const BoardEntry& entry : entries) {
    if (!acceptances.insert(entry.acceptance).second) {
      return absl::InvalidArgumentError(absl::StrCat("submission ", entry.submission,
                                                     ": its acceptance number ", entry.acceptance,
                                                     " is another's too"));
    }
    if (entry.failed) continue;
    RETURN_IF_ERROR(Check(entry, rules));
    teams[entry.team].push_back(RankedEntry{entry});
  }
  Ranked board = team_rule == TeamRule::kBest
                     ? BestOf(teams, rules)
                     : LastOf(teams, /*chosen=*/team_rule == TeamRule::kChosen);
  return Ordered(std::move(board), rules);
}

}  // namespace myograde::scoring
