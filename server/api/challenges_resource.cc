#include "server/api/resources.h"

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/api/more_seeds.h"
#include "server/api/phase_view.h"
#include "server/api/rejudge_document.h"
#include "server/api/rejudge_plan.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/challenge/phases.h"
#include "server/engine/stored.h"
#include "server/proof/seed_list.h"

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

// What a reveal makes known.
struct HiddenSeeds {
  std::string secret;  // 32 bytes
  std::vector<uint64_t> seeds;    // of the phase, which may be public
  std::vector<uint64_t> further;  // that follow from the secret after them, as far as they were played
};

// Before the close a reveal would end the phase for good, so nothing does it early.
absl::Status CheckOver(const PhaseConfig& phase, absl::Time now) {
  if (now >= phase.closes) return absl::OkStatus();
  const std::string when = phase.closes == absl::InfiniteFuture()
                               ? "it never closes; give it \"closes_at\" first"
                               : absl::StrCat("it closes at ", UtcText(phase.closes),
                                              "; reveal it afterwards");
  return absl::FailedPreconditionError(absl::StrCat(
      "the seeds of phase \"", phase.name, "\" can't be revealed while it takes submissions: ",
      when));
}

// The config that a phase has by its file, or had when no file describes it any more.
absl::StatusOr<TrackConfig> ConfigOf(Reader& reader, const Phases& phases,
                                     const std::string& name) {
  const absl::StatusOr<PhasePtr> phase = phases.Find(name);
  if (phase.ok()) return (*phase)->track->config;
  const std::string hash = phases.ConfigOf(name) == nullptr ? reader.ConfigOfPhase(name) : "";
  if (hash.empty()) return phase.status();
  return StoredConfig(reader, hash);
}

absl::Status NothingToReveal(const std::string& phase) {
  return absl::FailedPreconditionError(
      absl::StrCat("the seeds of phase \"", phase, "\" are public; there is nothing to reveal"));
}

absl::StatusOr<HiddenSeeds> SeedsToReveal(Reader& reader, const ApiContext& context,
                                          const std::string& name) {
  ASSIGN_OR_RETURN(const TrackConfig config, ConfigOf(reader, context.phases, name));
  const bool is_public = config.seed_salt.empty();
  absl::StatusOr<std::string> secret = reader.PhaseSecret(name);
  if (absl::IsNotFound(secret.status()) && is_public) return NothingToReveal(name);
  if (const PhaseConfig* phase = context.phases.ConfigOf(name)) {
    ASSIGN_OR_RETURN(const std::vector<PhaseEventRow> events, reader.PhaseEvents(name));
    const absl::Time now = context.clock.Now();
    const absl::Status over = CheckOver(*phase, now);
    // To move its close afterwards hides nothing again.
    if (!over.ok() && !StatusOfPhase(*phase, events, now).revealed) return over;
  }
  if (absl::IsNotFound(secret.status())) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this store does not have the secret of phase \"", name,
        "\", as exports do not hold it; reveal it where it was held, with \"myograde seeds reveal "
        "--secret\""));
  }
  if (!secret.ok()) return secret.status();
  ASSIGN_OR_RETURN(std::vector<uint64_t> further, PlayedFurtherSeeds(reader, name, *secret));
  if (is_public && further.empty()) return NothingToReveal(name);
  return HiddenSeeds{*std::move(secret), config.seeds, std::move(further)};
}

Json CreatedToJson(const CreatedRejudge& created, const NewRejudge& asked) {
  return {{"rejudge", created.rejudge.id},
          {"episodes", asked.seed_count},
          {"seeds_sha256", asked.seeds},
          {"submissions", asked.submissions},
          {"without_files", created.plan.without_files}};
}

ApiResult ListChallenges(const ApiContext& context, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    absl::StatusOr<Json> json = ChallengesToJson(reader, context);
    if (json.ok()) answer.body = *std::move(json);
    return json.status();
  }));
  return answer;
}

// Whether it has submissions, and no file any more.
bool IsFormerPhase(const ApiContext& context, const std::string& phase) {
  bool former = false;
  const absl::Status read = context.readers.Read([&](Reader& reader) {
    former = context.phases.ConfigOf(phase) == nullptr && !reader.ConfigOfPhase(phase).empty();
    return absl::OkStatus();
  });
  return read.ok() && former;
}

// The act of an organiser on a phase, or on all submissions (`phase` "").
ApiResult ActOnPhase(const ApiContext& context, const std::string& phase, const std::string& event,
                     const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const PhaseConfig* config = phase.empty() ? nullptr : context.phases.ConfigOf(phase);
  absl::Status status;
  if (config != nullptr) {
    status = CheckAct(*config, event, context.clock.Now());
  } else if (!phase.empty()) {
    status = context.phases.Find(phase).status();
    // What a phase withheld stays withheld until it is published, with a file or without.
    if (event == kPublishedEvent && IsFormerPhase(context, phase)) status = absl::OkStatus();
  }
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(const bool changed, context.engine.Change<bool>(
      [phase, event, who = CallerKey(), why = reason](Writer& writer) {
        return writer.AddPhaseEvent(phase, event, who, why);
      },
      context.config.http.request));
  Json state;
  if (config != nullptr) {
    status = context.readers.Read([&](Reader& reader) -> absl::Status {
      ASSIGN_OR_RETURN(const auto events, reader.PhaseEvents(phase));
      state = PhaseStateName(StatusOfPhase(*config, events, context.clock.Now()).state);
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

ApiResult ChooseSubmission(const ApiContext& context, const Request& request, const Json& body) {
  RETURN_IF_ERROR(ParseNothing(body));
  const int64_t id = IdOf(request);
  SubmissionRow row;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(row, reader.Submission(id));
    return CheckChoice(reader, row, context);
  }));
  ASSIGN_OR_RETURN(const bool changed, context.engine.Change<bool>(
      [id, who = CallerKey()](Writer& writer) { return writer.Choose(id, who); },
      context.config.http.request));
  return ApiAnswer{200, {{"submission", id},
                         {"team", row.team},
                         {"track", row.track},
                         {"profile", row.profile},
                         {"phase", TextOrNull(row.phase)},
                         {"changed", changed}}};
}

ApiResult RevealSeeds(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const std::string phase = request.matches[1];
  ASSIGN_OR_RETURN(const HiddenSeeds hidden, context.readers.Read<HiddenSeeds>(
      [&](Reader& reader) { return SeedsToReveal(reader, context, phase); }));
  ASSIGN_OR_RETURN(const bool changed, context.engine.Change<bool>(
      [phase, who = CallerKey(), why = reason](Writer& writer) {
        return writer.AddPhaseEvent(phase, kRevealedEvent, who, why);
      },
      context.config.http.request));
  NoteAct(absl::StrCat("phase ", phase), kRevealedEvent);
  return ApiAnswer{200, {{"phase", phase},
                         {"event", kRevealedEvent},
                         {"changed", changed},
                         {"reason", reason},
                         {"commitment", SecretCommitment(hidden.secret)},
                         {"secret", absl::BytesToHexString(hidden.secret)},
                         {"seeds_sha256", SeedListHash(hidden.seeds)},
                         {"seeds", hidden.seeds},
                         {"further_seeds", hidden.further}}};
}

// The secret of a phase. One whose own seeds are public gets one for its further seeds.
absl::StatusOr<std::string> SecretOfPhase(const ApiContext& context, const std::string& phase) {
  bool hidden = false;
  absl::StatusOr<std::string> secret = context.readers.Read<std::string>(
      [&](Reader& reader) -> absl::StatusOr<std::string> {
        ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context, phase, "", ""));
        hidden = !track->config.seed_salt.empty();
        return reader.PhaseSecret(phase);
      });
  if (!absl::IsNotFound(secret.status())) return secret;
  if (hidden) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this store does not have the secret of phase \"", phase,
        "\", as exports do not hold it; further seeds follow from it where it was held"));
  }
  return context.engine.Change<std::string>(
      [phase](Writer& writer) { return writer.FurtherSecret(phase); },
      context.config.http.request);
}

ApiResult PlayMoreSeeds(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const MoreSeedsRequest asked, ParseMoreSeeds(body, request.matches[1]));
  ASSIGN_OR_RETURN(const std::string secret, SecretOfPhase(context, asked.phase));
  ASSIGN_OR_RETURN(const auto rejudges, context.readers.Read<std::vector<NewRejudge>>([&](Reader& reader) {
                     return MakeFurtherRejudges(reader, context, asked, secret);
                   }));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context));
  Json created = Json::array();
  for (const NewRejudge& rejudge : rejudges) {
    ASSIGN_OR_RETURN(const CreatedRejudge made, context.engine.CreateRejudge(
        rejudge, sign, CallerKey(), context.config.http.request));
    NoteAct(absl::StrCat("rejudge ", made.rejudge.id), "created for further episodes");
    created.push_back(CreatedToJson(made, rejudge));
  }
  return ApiAnswer{201, {{"phase", asked.phase},
                         {"board", asked.board},
                         {"episodes", asked.episodes},
                         {"commitment", SecretCommitment(secret)},
                         {"reason", asked.reason},
                         {"rejudges", std::move(created)}}};
}

}  // namespace

void AddChallenges(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/challenges", Action::kReadChallenge, std::bind_front(ListChallenges, std::cref(context)));
  routes.Post(R"(/v1/submissions/(\d{1,18})/choose)", Action::kChoose,
              std::bind_front(ChooseSubmission, std::cref(context)));
  for (const auto& [verb, event] :
       {std::pair{"pause", kPausedEvent}, std::pair{"resume", kResumedEvent},
        std::pair{"publish", kPublishedEvent}}) {
    routes.Post(absl::StrCat(kPhasePath, verb), Action::kManagePhases,
                [&context, name = event](const Request& request, const Json& body) {
                  return ActOnPhase(context, request.matches[1], name, body);
                });
  }
  for (const auto& [verb, event] :
       {std::pair{"pause", kPausedEvent}, std::pair{"resume", kResumedEvent}}) {
    routes.Post(absl::StrCat("/v1/", verb), Action::kManagePhases,
                [&context, name = event](const Request&, const Json& body) {
                  return ActOnPhase(context, "", name, body);
                });
  }
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/reveal", Action::kManagePhases,
              std::bind_front(RevealSeeds, std::cref(context)));
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/more-seeds", Action::kManagePhases,
              std::bind_front(PlayMoreSeeds, std::cref(context)));
}

}  // namespace myograde::server
