#include "server/api/reveal_resource.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/more_seeds.h"
#include "server/api/requests.h"
#include "server/challenge/phases.h"
#include "server/engine/stored.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

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

}  // namespace

void RevealResource::Install(Routes& routes) {
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/reveal", Action::kManagePhases,
              std::bind_front(&RevealResource::Reveal, this));
}

ApiResult RevealResource::Reveal(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const std::string phase = request.matches[1];
  ASSIGN_OR_RETURN(const HiddenSeeds hidden, context_.readers.Read<HiddenSeeds>(
      [&](Reader& reader) { return SeedsToReveal(reader, context_, phase); }));
  ASSIGN_OR_RETURN(const bool changed, context_.engine.Change<bool>(
      [phase, who = CallerKey(), why = reason](Writer& writer) {
        return writer.AddPhaseEvent(phase, kRevealedEvent, who, why);
      },
      context_.config.http.request));
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

}  // namespace myograde::server
