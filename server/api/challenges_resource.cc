#include "server/api/challenges_resource.h"

#include <functional>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/phase_view.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/engine/stored.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Phases are named as tracks are.
constexpr char kPhasePath[] = "/v1/phases/([a-z0-9-]{1,64})/";

// Whether an act on a phase makes sense now.
absl::Status CheckAct(const PhaseConfig& phase, const std::string& event, absl::Time now) {
  const PhaseState state = StatusOfPhase(phase, {}, now).state;
  if (event == kPublishedEvent && state == PhaseState::kUpcoming) {
    return absl::FailedPreconditionError(absl::StrCat("phase \"", phase.name, "\" opens at ",
                                                      UtcText(phase.opens),
                                                      "; publish it afterwards"));
  }
  if (event == kPausedEvent && state == PhaseState::kClosed) {
    return absl::FailedPreconditionError(absl::StrCat("phase \"", phase.name, "\" closed at ",
                                                      UtcText(phase.closes),
                                                      ", so there is nothing to pause"));
  }
  return absl::OkStatus();
}

// Whether the team of a submission may choose it now.
absl::Status CheckChoice(Reader& reader, const SubmissionRow& row, const ApiContext& context) {
  ASSIGN_OR_RETURN(TrackPtr track, StoredTrack(reader, row.config));
  if (track->scoring.team != scoring::TeamRule::kChosen) {
    return absl::FailedPreconditionError(absl::StrCat(
        "submission ", row.id, " can't be chosen: on its board a team stands with its ",
        std::string(TeamRuleName(track->scoring.team)), " submission, so there is nothing to choose"));
  }
  if (row.phase.empty()) return absl::OkStatus();
  if (const PhaseConfig* phase = context.phases.ConfigOf(row.phase)) {
    return CheckOpen(*phase, context.clock.Now());
  }
  return WithErrorCode(absl::FailedPreconditionError(absl::StrCat(
                           "phase \"", row.phase, "\" is over: no challenge has it any more")),
                       "phase_closed");
}

}  // namespace

void ChallengesResource::Install(Routes& routes) {
  using Self = ChallengesResource;
  routes.Get("/v1/challenges", Action::kReadChallenge, std::bind_front(&Self::List, this));
  routes.Post(R"(/v1/submissions/(\d{1,18})/choose)", Action::kChoose,
              std::bind_front(&Self::Choose, this));
  for (const auto& [verb, event] :
       {std::pair{"pause", kPausedEvent}, std::pair{"resume", kResumedEvent},
        std::pair{"publish", kPublishedEvent}}) {
    routes.Post(absl::StrCat(kPhasePath, verb), Action::kManagePhases,
                [this, name = event](const Request& request, const Json& body) {
                  return Act(request.matches[1], name, body);
                });
  }
  for (const auto& [verb, event] :
       {std::pair{"pause", kPausedEvent}, std::pair{"resume", kResumedEvent}}) {
    routes.Post(absl::StrCat("/v1/", verb), Action::kManagePhases,
                [this, name = event](const Request&, const Json& body) {
                  return Act("", name, body);
                });
  }
}

ApiResult ChallengesResource::List(const Request& request) const {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    absl::StatusOr<Json> json = ChallengesToJson(reader, context_);
    if (json.ok()) answer.body = *std::move(json);
    return json.status();
  }));
  return answer;
}

bool ChallengesResource::IsFormer(const std::string& phase) const {
  bool former = false;
  const absl::Status read = context_.readers.Read([&](Reader& reader) {
    former = context_.phases.ConfigOf(phase) == nullptr && !reader.ConfigOfPhase(phase).empty();
    return absl::OkStatus();
  });
  return read.ok() && former;
}

ApiResult ChallengesResource::Act(const std::string& phase, const std::string& event,
                                  const Json& body) const {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const PhaseConfig* config = phase.empty() ? nullptr : context_.phases.ConfigOf(phase);
  absl::Status status;
  if (config != nullptr) {
    status = CheckAct(*config, event, context_.clock.Now());
  } else if (!phase.empty()) {
    status = context_.phases.Find(phase).status();
    // What a phase withheld stays withheld until it is published, with a file or without.
    if (event == kPublishedEvent && IsFormer(phase)) status = absl::OkStatus();
  }
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(const bool changed, context_.engine.Change<bool>(
      [phase, event, who = CallerKey(), why = reason](Writer& writer) {
        return writer.AddPhaseEvent(phase, event, who, why);
      },
      context_.config.http.request));
  Json state;
  if (config != nullptr) {
    status = context_.readers.Read([&](Reader& reader) -> absl::Status {
      ASSIGN_OR_RETURN(const auto events, reader.PhaseEvents(phase));
      state = PhaseStateName(StatusOfPhase(*config, events, context_.clock.Now()).state);
      return absl::OkStatus();
    });
  }
  RETURN_IF_ERROR(status);
  NoteAct(phase.empty() ? "all submissions" : absl::StrCat("phase ", phase), event);
  return ApiAnswer{200, {{"phase", TextOrNull(phase)},
                         {"event", event},
                         {"changed", changed},
                         {"state", std::move(state)},
                         {"reason", reason}}};
}

ApiResult ChallengesResource::Choose(const Request& request, const Json& body) const {
  RETURN_IF_ERROR(ParseNothing(body));
  const int64_t id = IdOf(request);
  SubmissionRow row;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(row, reader.Submission(id));
    return CheckChoice(reader, row, context_);
  }));
  ASSIGN_OR_RETURN(const bool changed, context_.engine.Change<bool>(
      [id, who = CallerKey()](Writer& writer) { return writer.Choose(id, who); },
      context_.config.http.request));
  return ApiAnswer{200, {{"submission", id},
                         {"team", row.team},
                         {"track", row.track},
                         {"profile", row.profile},
                         {"phase", TextOrNull(row.phase)},
                         {"changed", changed}}};
}

}  // namespace myograde::server
