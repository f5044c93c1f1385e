#include "server/access/sight.h"

#include <utility>

namespace myograde::server {

Visibility SightOf(Role role, const PhaseSight& phase) {
  if (role >= Role::kOrganiser) return {};
  Visibility sight = phase.published || phase.revealed ? Visibility{} : phase.shown;
  sight.seeds = !phase.committed || phase.revealed;
  sight.progress = true;
  sight.progress = phase.published || phase.revealed || SeesAll(sight);
  return sight;
}

std::vector<std::string_view> WithheldParts(const Visibility& sight) {
  std::vector<std::string_view> parts;
  for (const auto& [name, seen] : {std::pair("aggregate", sight.aggregate),
                                   std::pair("outcomes", sight.outcomes),
                                   std::pair("metrics", sight.metrics),
                                   std::pair("logs", sight.logs),
                                   std::pair("output", sight.output),
                                   std::pair("seeds", sight.seeds)}) {
    if (!seen) parts.emplace_back(name);
  }
  return parts;
}

}  // namespace myograde::server
