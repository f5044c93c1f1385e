#include "server/challenge/find_phase.h"

#include <algorithm>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

namespace myograde::server {
namespace {

bool Fits(const PhaseConfig& phase, const PhaseQuery& query) {
  return phase.track == query.track && (query.profile.empty() || phase.profile == query.profile);
}

// None of the phases that fit is open.
absl::Status NoneOpen(const std::vector<PhasePtr>& fitting, const PhaseQuery& query,
                      absl::Time now) {
  std::string what = absl::StrCat("no phase of track \"", query.track, "\"",
                                  query.profile.empty()
                                      ? ""
                                      : absl::StrCat(" in the profile \"", query.profile, "\""),
                                  " is open");
  // They are in order of opening.
  const auto next = std::find_if(fitting.begin(), fitting.end(), [&](const PhasePtr& phase) {
    return now < phase->config.opens;
  });
  if (next != fitting.end()) {
    absl::StrAppend(&what, "; \"", (*next)->config.name, "\" opens at ",
                    UtcText((*next)->config.opens));
  } else {
    absl::StrAppend(&what, ", and none opens later");
  }
  absl::StrAppend(&what, "; give \"episodes\" to practise");
  return WithErrorCode(absl::FailedPreconditionError(what), "phase_closed");
}

}  // namespace

bool HasPhases(const Phases& phases, const std::string& track) {
  const auto& challenges = phases.challenges();
  return std::any_of(challenges.begin(), challenges.end(), [&](const ChallengeConfig& challenge) {
    return std::any_of(challenge.phases.begin(), challenge.phases.end(),
                       [&](const PhaseConfig& phase) { return phase.track == track; });
  });
}

absl::StatusOr<PhasePtr> FindPhase(const Phases& phases, const PhaseQuery& query,
                                   absl::Time now) {
  if (!query.phase.empty()) {
    absl::StatusOr<PhasePtr> phase = phases.Find(query.phase);
    if (!phase.ok() || Fits((*phase)->config, query)) return phase;
    return absl::InvalidArgumentError(
        absl::StrCat("phase \"", query.phase, "\" is of track \"", (*phase)->config.track,
                     "\" in the profile \"", (*phase)->config.profile, "\"; submit to that"));
  }
  std::vector<PhasePtr> fitting;
  std::vector<PhasePtr> open;
  for (const PhasePtr& phase : phases.entries()) {
    if (!Fits(phase->config, query)) continue;
    fitting.push_back(phase);
    if (CheckOpen(phase->config, now).ok()) open.push_back(phase);
  }
  if (open.size() == 1) return open.front();
  if (open.empty()) return NoneOpen(fitting, query, now);
  return absl::InvalidArgumentError(absl::StrCat(
      "track \"", query.track, "\" has ", open.size(), " open phases; name one as \"phase\": ",
      absl::StrJoin(open, ", ", [](std::string* out, const PhasePtr& phase) {
        out->append(phase->config.name);
      })));
}

}  // namespace myograde::server
