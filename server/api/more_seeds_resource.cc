#include "server/api/more_seeds_resource.h"

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/more_seeds.h"
#include "server/api/rejudge_document.h"
#include "server/api/rejudge_plan.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json CreatedToJson(const CreatedRejudge& created, const NewRejudge& asked) {
  return {{"rejudge", created.rejudge.id},
          {"episodes", asked.seed_count},
          {"seeds_sha256", asked.seeds},
          {"submissions", asked.submissions},
          {"without_files", created.plan.without_files}};
}

}  // namespace

void MoreSeedsResource::Install(Routes& routes) {
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/more-seeds", Action::kManagePhases,
              std::bind_front(&MoreSeedsResource::Play, this));
}

absl::StatusOr<std::string> MoreSeedsResource::SecretOf(const std::string& phase) const {
  bool hidden = false;
  absl::StatusOr<std::string> secret = context_.readers.Read<std::string>(
      [&](Reader& reader) -> absl::StatusOr<std::string> {
        ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context_, phase, "", ""));
        hidden = !track->config.seed_salt.empty();
        return reader.PhaseSecret(phase);
      });
  if (!absl::IsNotFound(secret.status())) return secret;
  if (hidden) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this store does not have the secret of phase \"", phase,
        "\", as exports do not hold it; further seeds follow from it where it was held"));
  }
  return context_.engine.Change<std::string>(
      [phase](Writer& writer) { return writer.FurtherSecret(phase); },
      context_.config.http.request);
}

ApiResult MoreSeedsResource::Play(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(const MoreSeedsRequest asked, ParseMoreSeeds(body, request.matches[1]));
  ASSIGN_OR_RETURN(const std::string secret, SecretOf(asked.phase));
  ASSIGN_OR_RETURN(const auto rejudges, context_.readers.Read<std::vector<NewRejudge>>([&](Reader& reader) {
                     return MakeFurtherRejudges(reader, context_, asked, secret);
                   }));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context_));
  Json created = Json::array();
  for (const NewRejudge& rejudge : rejudges) {
    ASSIGN_OR_RETURN(const CreatedRejudge made, context_.engine.CreateRejudge(
        rejudge, sign, CallerKey(), context_.config.http.request));
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

}  // namespace myograde::server
