#include "scoring/standing.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

namespace myograde::scoring {
namespace {

// Entries settle in two or three rounds; those that have not after this many go round in circles.
constexpr int kMostRounds = 16;

class Entries {
 public:
  Entries(const std::vector<BandCandidate>& candidates,
          const std::function<bool(double, double)>& belongs)
      : all_(candidates), belongs_(belongs) {}

  void Submit(size_t added) {
    const size_t team = all_[added].team;
    Team& own = TeamOf(team);
    const std::optional<size_t> before = own.entry;
    const int64_t rank_before = before ? Above(*before) : 0;
    if (!Add(own, added) || !ChooseBest(own, /*loyal=*/false)) return;
    const std::vector<size_t> kept = standing_;
    if (!Settle() || (before && Above(*TeamOf(team).entry) > rank_before)) Restore(kept);
  }

  const std::vector<size_t>& standing() const { return standing_; }

 private:
  struct Team {
    std::vector<size_t> own;  // no one of them beats another in both orders
    std::optional<size_t> entry;
  };

  Team& TeamOf(size_t team) {
    const auto [it, added] = places_.emplace(team, teams_.size());
    if (added) teams_.emplace_back();
    return teams_[it->second];
  }

  // One that another of the team beats in both orders never ranks above that one.
  bool Add(Team& team, size_t added) {
    const auto beats = [&](size_t a, size_t b) {
      return a < b && all_[a].inside < all_[b].inside;
    };
    for (const size_t own : team.own) {
      if (beats(own, added)) return false;
    }
    std::erase_if(team.own, [&](size_t own) { return beats(added, own); });
    team.own.insert(std::upper_bound(team.own.begin(), team.own.end(), added), added);
    return true;
  }

  // How many of `among`, which is in ascending order, stand above `candidate` on a board of both; its
  // team's are left out unless `own`.
  int64_t Above(size_t candidate, const std::vector<size_t>& among, bool own) const {
    int64_t above = 0, in_band = 0, better = 0;
    bool placed = false, open = false;
    double opener = 0;
    const auto place = [&](size_t next) {
      if (!open || !belongs_(all_[next].value, opener)) {
        if (placed) return false;
        above += std::exchange(in_band, 0);
        better = 0;
        open = true;
        opener = all_[next].value;
      }
      if (next == candidate) {
        placed = true;
      } else {
        ++in_band;
        better += all_[next].inside < all_[candidate].inside ? 1 : 0;
      }
      return true;
    };
    for (const size_t other : among) {
      if (!own && all_[other].team == all_[candidate].team) continue;
      if (own && other == candidate) continue;
      if (!placed && candidate < other && !place(candidate)) break;
      if (!place(other)) break;
    }
    if (!placed) place(candidate);
    return above + better;
  }
  int64_t Above(size_t candidate) const { return Above(candidate, standing_, /*own=*/false); }

  // True if the team has another entry now. `loyal`: it keeps its entry unless another one ranks better.
  bool ChooseBest(Team& team, bool loyal) {
    if (team.own.size() == 1 && team.entry == team.own.front()) return false;
    const auto key = [&](size_t own) {
      return std::pair(Above(own), Above(own, team.own, /*own=*/true));
    };
    const size_t best = *std::min_element(
        team.own.begin(), team.own.end(), [&](size_t a, size_t b) { return key(a) < key(b); });
    if (team.entry == best) return false;
    if (loyal && Above(best) >= Above(*team.entry)) return false;
    if (team.entry) std::erase(standing_, *team.entry);
    standing_.insert(std::upper_bound(standing_.begin(), standing_.end(), best), best);
    team.entry = best;
    return true;
  }

  // False if entries go on changing.
  bool Settle() {
    for (int round = 0; round < kMostRounds; ++round) {
      bool changed = false;
      for (Team& team : teams_) changed = ChooseBest(team, /*loyal=*/true) || changed;
      if (!changed) return true;
    }
    return false;
  }

  void Restore(const std::vector<size_t>& standing) {
    standing_ = standing;
    for (const size_t entry : standing_) TeamOf(all_[entry].team).entry = entry;
  }

  const std::vector<BandCandidate>& all_;
  const std::function<bool(double, double)>& belongs_;
  std::vector<Team> teams_;            // by their first submission
  std::map<size_t, size_t> places_;    // in teams_
  std::vector<size_t> standing_;       // ascending
};

}  // namespace

std::vector<size_t> StandingEntries(const std::vector<BandCandidate>& candidates,
                                    const std::function<bool(double, double)>& belongs) {
  std::vector<size_t> by_acceptance(candidates.size());
  std::iota(by_acceptance.begin(), by_acceptance.end(), size_t{0});
  std::sort(by_acceptance.begin(), by_acceptance.end(), [&](size_t a, size_t b) {
    return candidates[a].acceptance < candidates[b].acceptance;
  });
  Entries entries(candidates, belongs);
  for (const size_t next : by_acceptance) entries.Submit(next);
  return entries.standing();
}

}  // namespace myograde::scoring
