#include "server/api/phase_view.h"

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/escaping.h>

#include "protocol/base/status_macros.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using Events = std::vector<PhaseEventRow>;

// Null for a time that never comes, or always was.
Json MomentToJson(absl::Time time) {
  if (time == absl::InfinitePast() || time == absl::InfiniteFuture()) return nullptr;
  return TimeToJson(absl::ToUnixMillis(time));
}

Json PauseToJson(const std::optional<PhaseEventRow>& pause) {
  if (!pause.has_value()) return nullptr;
  return {{"reason", pause->why}, {"at", TimeToJson(pause->at)}, {"all", pause->phase.empty()}};
}

Json QuotaToJson(const AdmissionRules& rules) {
  const QuotaLimits& limits = rules.quota;
  return {{"official_per_day", limits.ranked.per_day},
          {"official_total", limits.ranked.total},
          {"failed_per_day", limits.failed.per_day},
          {"failed_total", limits.failed.total},
          {"waiting", limits.waiting},
          {"same_artefact", rules.one_for_everyone ? "everyone" : "team"}};
}

Json ShownToJson(const Visibility& shown) {
  return {{"aggregate", shown.aggregate}, {"outcomes", shown.outcomes},
          {"metrics", shown.metrics},     {"logs", shown.logs},
          {"output", shown.output}};
}

// What of a phase's seeds is public.
Json PublicSeeds(Reader& reader, const Phase& phase, bool revealed) {
  const auto count = phase.track->config.seeds.size();
  if (phase.commitment.empty()) return {{"kind", "public"}, {"count", count}};
  Json seeds = {{"kind", "committed"},
                {"count", count},
                {"commitment", phase.commitment},
                {"secret", nullptr}};
  if (!revealed) return seeds;
  const absl::StatusOr<std::string> secret = reader.PhaseSecret(phase.config.name);
  if (secret.ok()) seeds["secret"] = absl::BytesToHexString(*secret);
  return seeds;
}

Json PhaseToJson(Reader& reader, const ApiContext& context, const Phase& phase,
                 const Events& events, int64_t waiting) {
  const PhaseConfig& config = phase.config;
  const TrackConfig& track = phase.track->config;
  const PhaseStatus status = StatusOfPhase(config, events, context.clock.Now());
  return {{"phase", config.name},
          {"title", config.title},
          {"track", config.track},
          {"track_kind", track.kind->name},
          {"profile", config.profile},
          {"state", PhaseStateName(status.state)},
          {"paused", PauseToJson(status.pause)},
          {"opens_at", MomentToJson(config.opens)},
          {"closes_at", MomentToJson(config.closes)},
          {"freeze_at", MomentToJson(config.freezes)},
          {"frozen", status.frozen},
          {"published", status.published},
          {"revealed", status.revealed},
          {"entry", TeamRuleName(phase.track->scoring.team)},
          {"teams", config.teams.empty() ? Json() : Json(config.teams)},
          {"seeds", PublicSeeds(reader, phase, status.revealed)},
          {"quota", QuotaToJson(PhaseRules(config, context.config.quota.of(config.track)))},
          {"show", ShownToJson(config.shown)},
          {"episodes", track.seeds.size()},
          {"waiting", waiting},
          {"config", track.hash}};
}

// The pause of all submissions that is in force; null: none.
Json PauseOfAll(const Events& events) {
  std::optional<PhaseEventRow> pause;
  for (const PhaseEventRow& event : events) {
    if (!event.phase.empty()) continue;
    if (event.event == kPausedEvent) pause = event;
    if (event.event == kResumedEvent) pause = std::nullopt;
  }
  return PauseToJson(pause);
}

// Phases that only the store knows.
Json FormerPhases(const std::map<std::string, PhaseUse>& uses, const Phases& phases) {
  Json former = Json::array();
  for (const auto& [name, use] : uses) {
    if (phases.ConfigOf(name) != nullptr) continue;
    former.push_back({{"phase", name},
                      {"track", use.track},
                      {"profile", use.profile},
                      {"submissions", use.submissions},
                      {"waiting", use.waiting}});
  }
  return former;
}

}  // namespace

absl::StatusOr<nlohmann::json> ChallengesToJson(Reader& reader, const ApiContext& context) {
  ASSIGN_OR_RETURN(const Events events, reader.PhaseEvents(std::nullopt));
  ASSIGN_OR_RETURN(std::vector<PhaseUse> listed, reader.PhasesInUse());
  std::map<std::string, PhaseUse> uses;
  for (PhaseUse& use : listed) uses.emplace(use.phase, std::move(use));
  Json challenges = Json::array();
  for (const ChallengeConfig& challenge : context.phases.challenges()) {
    Json phases = Json::array();
    for (const PhasePtr& phase : context.phases.entries()) {
      if (phase->config.challenge != challenge.name) continue;
      const auto use = uses.find(phase->config.name);
      phases.push_back(PhaseToJson(reader, context, *phase, events,
                                   use == uses.end() ? 0 : use->second.waiting));
    }
    challenges.push_back({{"challenge", challenge.name},
                          {"title", challenge.title},
                          {"phases", std::move(phases)}});
  }
  Json unusable = Json::array();
  for (const auto& [name, why] : context.phases.unusable()) {
    unusable.push_back({{"phase", name}, {"message", std::string(why.message())}});
  }
  return Json{{"now", TimeToJson(absl::ToUnixMillis(context.clock.Now()))},
              {"paused", PauseOfAll(events)},
              {"challenges", std::move(challenges)},
              {"former_phases", FormerPhases(uses, context.phases)},
              {"unusable", std::move(unusable)}};
}

}  // namespace myograde::server
