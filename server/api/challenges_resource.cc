#include "server/api/resources.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "server/api/negotiation.h"
#include "server/base/error_code.h"
#include "server/challenge/phases.h"

namespace myograde::server {
namespace {

// Null for a time that never comes, or always was.
Json MomentToJson(absl::Time time) {
  if (time == absl::InfinitePast() || time == absl::InfiniteFuture()) return nullptr;
  return TimeToJson(absl::ToUnixMillis(time));
}

Json PauseToJson(const PhaseEventRow* pause) {
  if (pause == nullptr) return nullptr;
  return {{"reason", pause->why}, {"at", TimeToJson(pause->at)}, {"all", pause->phase.empty()}};
}

// What of a phase's seeds is public.
Json PublicSeeds(const Transaction& reader, const Phase& phase, bool revealed) {
  const auto count = phase.track->config.seeds.size();
  if (phase.commitment.empty()) return {{"kind", "public"}, {"count", count}};
  Json seeds = {{"kind", "committed"},
                {"count", count},
                {"commitment", phase.commitment},
                {"secret", nullptr}};
  if (!revealed) return seeds;
  const absl::StatusOr<std::string> secret = reader.phases.Secret(phase.config.name);
  if (secret.ok()) seeds["secret"] = absl::BytesToHexString(*secret);
  return seeds;
}

Json PhaseToJson(const Transaction& reader, const ApiContext& context, const Phase& phase,
                 const PhaseUse& use) {
  const PhaseConfig& config = phase.config;
  const TrackConfig& track = phase.track->config;
  const PhaseStatus status = StatusOfPhase(config, reader.Board(), context.clock.Now());
  const AdmissionRules rules = PhaseRules(config, context.config.quota.of(config.track));
  const QuotaLimits& limits = rules.quota;
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
          {"quota",
           {{"official_per_day", limits.ranked.per_day},
            {"official_total", limits.ranked.total},
            {"failed_per_day", limits.failed.per_day},
            {"failed_total", limits.failed.total},
            {"waiting", limits.waiting},
            {"same_artefact", rules.one_for_everyone ? "everyone" : "team"}}},
          {"show",
           {{"aggregate", config.shown.aggregate},
            {"outcomes", config.shown.outcomes},
            {"metrics", config.shown.metrics},
            {"logs", config.shown.logs},
            {"output", config.shown.output}}},
          {"episodes", track.seeds.size()},
          {"submissions", use.submissions},
          {"waiting", use.waiting},
          {"config", track.hash}};
}

ApiResult ListChallenges(const ApiContext& context, const Transaction& reader,
                         const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  std::map<std::string, PhaseUse> uses;
  for (PhaseUse& use : reader.phases.InUse()) uses.emplace(use.phase, std::move(use));
  Json challenges = Json::array();
  for (const ChallengeConfig& challenge : context.phases.challenges()) {
    Json phases = Json::array();
    for (const PhaseConfig& config : challenge.phases) {
      const absl::StatusOr<PhasePtr> phase = context.phases.Find(config.name);
      if (!phase.ok()) continue;  // it is among the unusable
      const auto use = uses.find(config.name);
      phases.push_back(PhaseToJson(reader, context, **phase,
                                   use == uses.end() ? PhaseUse() : use->second));
    }
    challenges.push_back(
        {{"challenge", challenge.name},
         {"title", challenge.title},
         {"text", challenge.text},
         {"logo", !challenge.logo.empty()},
         {"phases", std::move(phases)}});
  }
  Json former = Json::array();  // that only the store knows
  for (const auto& [name, use] : uses) {
    if (context.phases.ConfigOf(name) != nullptr) continue;
    former.push_back({{"phase", name},
                      {"track", use.track},
                      {"profile", use.profile},
                      {"submissions", use.submissions},
                      {"waiting", use.waiting}});
  }
  Json unusable = Json::array();
  for (const auto& [name, why] : context.phases.unusable()) {
    unusable.push_back({{"phase", name}, {"message", std::string(why.message())}});
  }
  return ApiAnswer{200,
                   {{"now", TimeToJson(absl::ToUnixMillis(context.clock.Now()))},
                    {"paused", PauseToJson(reader.Board().Phase("").Pause())},
                    {"challenges", std::move(challenges)},
                    {"former_phases", std::move(former)},
                    {"unusable", std::move(unusable)}}};
}

// Whether an act on a phase makes sense now.
absl::Status CheckAct(const PhaseConfig& phase, const std::string& event, absl::Time now) {
  const PhaseState state = StatusOfPhase(phase, {}, now).state;
  if (event == kPublishedEvent && state == PhaseState::kUpcoming) {
    return absl::FailedPreconditionError(absl::StrCat(
        "phase \"", phase.name, "\" opens at ", UtcText(phase.opens), "; publish it afterwards"));
  }
  if (event == kPausedEvent && state == PhaseState::kClosed) {
    return absl::FailedPreconditionError(absl::StrCat("phase \"", phase.name, "\" closed at ",
                                                      UtcText(phase.closes),
                                                      ", so there is nothing to pause"));
  }
  return absl::OkStatus();
}

// Whether the team of a submission may choose it now.
absl::Status CheckChoice(const Transaction& reader, const SubmissionRow& row,
                         const ApiContext& context) {
  ASSIGN_OR_RETURN(TrackPtr track, StoredTrack(reader, row.config));
  if (track->scoring.team != scoring::TeamRule::kChosen) {
    return absl::FailedPreconditionError(absl::StrCat(
        "submission ", row.id, " can't be chosen: its board ranks each team's ",
        std::string(TeamRuleName(track->scoring.team)),
        " submission, so there is nothing to choose"));
  }
  if (row.phase.empty()) return absl::OkStatus();
  if (const PhaseConfig* phase = context.phases.ConfigOf(row.phase)) {
    return CheckOpen(*phase, context.clock.Now());
  }
  return WithErrorCode(absl::FailedPreconditionError(absl::StrCat(
                           "phase \"", row.phase, "\" is over: no challenge has it any longer")),
                       "phase_closed");
}

// The act of an organiser on a phase, or on all submissions (`phase` "").
ApiResult ActOnPhase(const ApiContext& context, const std::string& phase, const std::string& event,
                     const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const PhaseConfig* config = phase.empty() ? nullptr : context.phases.ConfigOf(phase);
  if (config != nullptr) {
    RETURN_IF_ERROR(CheckAct(*config, event, context.clock.Now()));
  } else if (!phase.empty()) {
    const auto former = ReadStore(context, [&](const Transaction& reader) {
      return reader.Board().ConfigOfPhase(phase);
    });
    // What a phase withheld stays withheld until it is published, with a file or without.
    const bool known = former.ok() && !former->empty();
    if (event != kPublishedEvent || !known) RETURN_IF_ERROR(context.phases.Find(phase).status());
  }
  const auto add = [phase, event, reason, who = CallerKey()](Transaction& writer) {
    return writer.phases.AddEvent(phase, event, who, reason);
  };
  ASSIGN_OR_RETURN(const bool changed, ChangeStore(context, add));
  Json state;
  if (config != nullptr) {
    ASSIGN_OR_RETURN(const PhaseState now, ReadStore(context, [&](const Transaction& reader) {
      return StatusOfPhase(*config, reader.Board(), context.clock.Now()).state;
    }));
    state = PhaseStateName(now);
  }
  NoteAct(phase.empty() ? "all submissions" : absl::StrCat("phase ", phase), event);
  return ApiAnswer{200,
                   {{"phase", TextOrNull(phase)},
                    {"event", event},
                    {"changed", changed},
                    {"state", std::move(state)},
                    {"reason", reason}}};
}

ApiResult ChooseSubmission(const ApiContext& context, const Request& request, const Json& body) {
  RETURN_IF_ERROR(ParseNothing(body));
  const int64_t id = ReadId(request);
  SubmissionRow row;
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& reader) -> absl::Status {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(row, reader.submissions.Find(id));
    return CheckChoice(reader, row, context);
  }));
  const auto choose = [id, who = CallerKey()](Transaction& writer) {
    return writer.journal.Choose(id, who);
  };
  ASSIGN_OR_RETURN(const bool changed, ChangeStore(context, choose));
  return ApiAnswer{200,
                   {{"submission", id},
                    {"team", row.team},
                    {"track", row.track},
                    {"profile", row.profile},
                    {"phase", TextOrNull(row.phase)},
                    {"changed", changed}}};
}

absl::Status SendLogo(const ApiContext& context, const Request& request, Response& response) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  const auto& all = context.phases.challenges();
  const auto found = std::find_if(all.begin(), all.end(), [&](const ChallengeConfig& challenge) {
    return challenge.name == request.matches[1] && !challenge.logo.empty();
  });
  if (found == all.end()) {
    return absl::NotFoundError(absl::StrCat("there is no logo of a challenge \"",
                                            std::string(request.matches[1]), "\""));
  }
  response.SetHeader("Cache-Control", "no-cache");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  if (!AnswersWithTag(request, ComputeEntityTag(found->logo), response)) {
    response.SetContent(found->logo, "image/png");
  }
  return absl::OkStatus();
}

}  // namespace

void AddChallenges(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/challenges", Action::kReadChallenge, Bind(context, ListChallenges));
  routes.GetFile(R"(/v1/challenges/([a-z0-9-]{1,64})/logo[.]png)", Action::kReadChallenge,
                 Bind(context, SendLogo));
  routes.Post(R"(/v1/submissions/(\d{1,18})/choose)", Action::kChoose,
              Bind(context, ChooseSubmission));
  for (const auto& [verb, event] :
       {std::pair{"pause", kPausedEvent}, std::pair{"resume", kResumedEvent},
        std::pair{"publish", kPublishedEvent}}) {
    routes.Post(absl::StrCat("/v1/phases/([a-z0-9-]{1,64})/", verb), Action::kManagePhases,
                [&context, name = event](const Request& request, const Json& body) {
                  return ActOnPhase(context, request.matches[1], name, body);
                });
    if (std::string_view(event) == kPublishedEvent) continue;  // each phase by itself
    routes.Post(absl::StrCat("/v1/", verb), Action::kManagePhases,
                [&context, name = event](const Request&, const Json& body) {
                  return ActOnPhase(context, "", name, body);
                });
  }
}

}  // namespace myograde::server
