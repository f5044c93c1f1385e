// What is wrong with the challenges of a server, before anything opens.
#include <set>

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"
#include "server/challenge/challenge.h"

namespace myograde::server {
namespace {

// A phase with what its checks need.
struct CheckedPhase {
  const PhaseConfig* config = nullptr;
  std::string place;       // "FILE: phase "NAME""
  TrackPtr track;          // the track's own; nullptr: there is none
  std::set<uint64_t> seeds;  // that everybody knows
};

class Checks {
 public:
  Checks(const std::vector<ChallengeConfig>& challenges, const Tracks& tracks, absl::Time now)
      : tracks_(tracks), now_(now) {
    for (const ChallengeConfig& challenge : challenges) {
      for (const PhaseConfig& phase : challenge.phases) {
        phases_.push_back({&phase, absl::StrCat(challenge.where, ": phase \"", phase.name, "\""),
                           nullptr, {}});
      }
    }
  }

  ChallengeFindings Run() {
    for (CheckedPhase& phase : phases_) {
      CheckName(phase);
      CheckTimes(phase);
      CheckTrack(phase);
      CheckShown(phase);
      CheckQuotaOf(phase);
    }
    for (const CheckedPhase& phase : phases_) CheckSeeds(phase);
    return std::move(found_);
  }

 private:
  void Mistake(const CheckedPhase& phase, const std::string& what) {
    found_.mistakes.push_back(absl::StrCat(phase.place, ": ", what));
  }
  void Warning(const CheckedPhase& phase, const std::string& what) {
    found_.warnings.push_back(absl::StrCat(phase.place, ": ", what));
  }

  void CheckName(const CheckedPhase& phase) {
    for (const CheckedPhase& other : phases_) {
      if (&other == &phase) return;
      if (other.config->name != phase.config->name) continue;
      Mistake(phase, absl::StrCat("the name is taken by ", other.place,
                                  "; names are unique among all files, so choose another"));
      return;
    }
  }

  void CheckTimes(const CheckedPhase& phase) {
    const PhaseConfig& config = *phase.config;
    const bool freezes = config.freezes != absl::InfiniteFuture();
    if (config.closes <= config.opens) {
      Mistake(phase, absl::StrCat("\"closes_at\" (", UtcText(config.closes),
                                  ") must be later than \"opens_at\" (", UtcText(config.opens),
                                  ")"));
    } else if (freezes && (config.freezes < config.opens || config.freezes > config.closes)) {
      Mistake(phase, absl::StrCat("\"freeze_at\" (", UtcText(config.freezes),
                                  ") must lie between \"opens_at\" and \"closes_at\""));
    }
    if (config.committed != 0 && config.closes == absl::InfiniteFuture()) {
      Warning(phase, "it never closes, so its committed seeds can't be revealed; add \"closes_at\"");
    }
    if (config.closes <= now_) {
      Warning(phase, absl::StrCat("it closed at ", UtcText(config.closes),
                                  " already, so nothing can be submitted to it"));
    } else if (config.opens <= now_ && config.opens != absl::InfinitePast()) {
      Warning(phase, absl::StrCat("its opening at ", UtcText(config.opens),
                                  " is in the past: it is open as soon as a daemon loads it"));
    }
  }

  void CheckTrack(CheckedPhase& phase) {
    const PhaseConfig& config = *phase.config;
    const absl::StatusOr<TrackPtr> track = tracks_.Find(config.track, config.profile);
    if (!track.ok()) return Mistake(phase, std::string(track.status().message()));
    phase.track = *track;
    // Any secret shows whether the phase's config is one.
    const std::string secret(32, '\0');
    if (const auto made = PhaseTrack(config, **track, secret); !made.ok()) {
      Mistake(phase, std::string(made.status().message()));
    }
    if (config.committed != 0) return;
    const std::vector<uint64_t>& seeds =
        config.seeds.empty() ? (*track)->config.seeds : config.seeds;
    phase.seeds = {seeds.begin(), seeds.end()};
  }

  void CheckShown(const CheckedPhase& phase) {
    const PhaseConfig& config = *phase.config;
    if (config.committed != 0 && config.shown.logs) {
      Mistake(phase, "\"show\" has \"logs\": true, and a log holds its episode's seed, which is "
                     "committed; set it to false");
    }
    const bool hidden_board = config.freezes <= config.opens;
    if (!config.shown.aggregate && !hidden_board) {
      Mistake(phase, "\"show\" has \"aggregate\": false, and the board would show the aggregates of "
                     "all teams; set \"freeze_at\" to the time of \"opens_at\", or show them");
    }
  }

  void CheckQuotaOf(const CheckedPhase& phase) {
    const PhaseConfig& config = *phase.config;
    if (!config.quota.official_per_day || !config.quota.official_total) return;
    const int64_t per_day = *config.quota.official_per_day;
    const int64_t total = *config.quota.official_total;
    if (per_day > total) {
      Warning(phase, absl::StrCat("\"official_per_day\" is ", per_day, ", and a team has ", total,
                                  " in all"));
    }
    const absl::Duration length = config.closes - config.opens;
    if (length <= absl::ZeroDuration() || length == absl::InfiniteDuration()) return;
    // It may begin and end within a day.
    const int64_t days = absl::ToInt64Hours(length) / 24 + 2;
    if (per_day <= total / days) {
      Warning(phase, absl::StrCat("it is open on ", Counted(days, "day"), " at most, on which ",
                                  per_day, " a day never use up the ", total, " of a team"));
    } else if (total / per_day < days / 4) {
      Warning(phase, absl::StrCat("with ", per_day, " a day a team has used up its ", total,
                                  " after ", Counted(total / per_day, "day"), " of ", days));
    }
  }

  // Whoever knows a seed before a phase can train on it.
  void CheckSeeds(const CheckedPhase& phase) {
    if (phase.seeds.empty() || phase.track == nullptr) return;
    for (const CheckedPhase& other : phases_) {
      if (&other == &phase) break;
      // Equal seeds of different environments have nothing in common.
      if (other.track == nullptr || other.track->config.kind != phase.track->config.kind) continue;
      Overlap(phase, other.seeds, absl::StrCat("phase \"", other.config->name, "\""),
              "give each phase seeds of its own");
    }
    for (const auto& [name, offer] : tracks_.entries()) {
      if (offer.profiles.begin()->second->config.kind != phase.track->config.kind) continue;
      if (CheckTracksSeeds(phase, name, offer)) return;
    }
  }

  // Whether there is a mistake, so that the profiles of a track, which mostly have the same seeds,
  // are told of once.
  bool CheckTracksSeeds(const CheckedPhase& phase, const std::string& name,
                        const Tracks::Entry& offer) {
    for (const auto& [profile, track] : offer.profiles) {
      const TrackConfig& config = track->config;
      if (Overlap(phase, {config.practice_seeds.begin(), config.practice_seeds.end()},
                  absl::StrCat("the practice of track \"", name, "\""),
                  "give the phase other seeds, or the track other \"practice_seeds\"")) {
        return true;
      }
      if (phase.config->seeds.empty()) continue;
      if (Overlap(phase, {config.seeds.begin(), config.seeds.end()},
                  absl::StrCat("track \"", name, "\" itself"),
                  "give the phase other seeds, or none to play the track's own")) {
        return true;
      }
    }
    return false;
  }

  // Whether it is one.
  bool Overlap(const CheckedPhase& phase, const std::set<uint64_t>& others,
               const std::string& whose, const std::string& advice) {
    int64_t count = 0;
    uint64_t first = 0;
    for (const uint64_t seed : phase.seeds) {
      if (!others.contains(seed)) continue;
      if (count++ == 0) first = seed;
    }
    if (count == 0) return false;
    Mistake(phase, absl::StrCat(count == 1 ? "its seed " : absl::StrCat(count, " of its seeds, from "),
                                first, count == 1 ? " belongs to " : " on, belong to ", whose,
                                " too; ", advice));
    return true;
  }

  const Tracks& tracks_;
  const absl::Time now_;
  std::vector<CheckedPhase> phases_;
  ChallengeFindings found_;
};

}  // namespace

ChallengeFindings CheckChallenges(const std::vector<ChallengeConfig>& challenges,
                                  const Tracks& tracks, absl::Time now) {
  return Checks(challenges, tracks, now).Run();
}

}  // namespace myograde::server
