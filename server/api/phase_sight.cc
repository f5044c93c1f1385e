#include "server/api/phase_sight.h"

#include <vector>

#include "server/challenge/phases.h"

namespace myograde::server {

absl::StatusOr<Visibility> SightOfPhase(Reader& reader, const ApiContext& context, Role role,
                                        const std::string& phase) {
  if (phase.empty() || role >= Role::kOrganiser) return Visibility{};
  const absl::StatusOr<std::vector<PhaseEventRow>> events = reader.PhaseEvents(phase);
  if (!events.ok()) return events.status();
  PhaseSight known = {.shown = kSightOfUnknownPhase, .committed = true};
  for (const PhasePtr& entry : context.phases.entries()) {
    if (entry->config.name != phase) continue;
    known.shown = entry->config.shown;
    known.committed = entry->config.committed != 0;
  }
  for (const PhaseEventRow& event : *events) {
    if (event.phase != phase) continue;
    known.published = known.published || event.event == kPublished;
    known.revealed = known.revealed || event.event == kRevealed;
  }
  return SightOf(role, known);
}

absl::StatusOr<Visibility> SightOfConfig(Reader& reader, const ApiContext& context, Role role,
                                         const TrackConfig& config) {
  absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, role, config.phase);
  // The salt tells for sure, whatever the files say today.
  if (sight.ok() && config.seed_salt.empty()) sight->seeds = true;
  return sight;
}

}  // namespace myograde::server
