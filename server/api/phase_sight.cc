#include "server/api/phase_sight.h"

#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/challenge/phases.h"
#include "server/store/quota.h"

namespace myograde::server {

namespace {

absl::StatusOr<PhaseSight> KnownOf(Reader& reader, const ApiContext& context,
                                   const std::string& phase) {
  ASSIGN_OR_RETURN(const std::vector<PhaseEventRow> events, reader.PhaseEvents(phase));
  PhaseSight known = {.shown = kSightOfUnknownPhase, .committed = true};
  if (const PhaseConfig* config = context.phases.ConfigOf(phase)) {
    known.shown = config->shown;
    known.committed = config->committed != 0;
  }
  for (const PhaseEventRow& event : events) {
    if (event.phase != phase) continue;
    known.published = known.published || event.event == kPublishedEvent;
    known.revealed = known.revealed || event.event == kRevealedEvent;
  }
  return known;
}

}  // namespace

absl::StatusOr<bool> IsPhasePublic(Reader& reader, const ApiContext& context,
                                   const std::string& phase) {
  if (phase.empty()) return true;
  ASSIGN_OR_RETURN(const PhaseSight known, KnownOf(reader, context, phase));
  if (known.published || known.revealed) return true;
  const PhaseConfig* config = context.phases.ConfigOf(phase);
  const Visibility sight = SightOf(Role::kParticipant, known);
  return config != nullptr && config->freezes == absl::InfiniteFuture() && sight.aggregate &&
         SeesReceipt(sight);
}

absl::StatusOr<Visibility> SightOfPhase(Reader& reader, const ApiContext& context,
                                        const std::string& phase) {
  const Role role = Caller().role;
  if (phase.empty() || role >= Role::kOrganiser) return Visibility{};
  ASSIGN_OR_RETURN(const PhaseSight known, KnownOf(reader, context, phase));
  return SightOf(role, known);
}

absl::StatusOr<Visibility> SightOfConfig(Reader& reader, const ApiContext& context,
                                         const TrackConfig& config) {
  if (config.phase.empty()) return Visibility{};
  absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, config.phase);
  // The salt tells for sure whether there is anything to hide, whatever the files say today.
  if (sight.ok() && config.seed_salt.empty() && !sight->seeds) {
    sight->seeds = true;
    sight->progress = true;
    sight->progress = SeesAll(*sight);
  }
  return sight;
}

absl::Status WithheldError(const std::string& what) {
  return WithErrorCode(absl::FailedPreconditionError(absl::StrCat(
                           what, "; wait until the organiser has published the phase and revealed "
                                 "its seeds")),
                       kWithheldCode);
}

}  // namespace myograde::server
