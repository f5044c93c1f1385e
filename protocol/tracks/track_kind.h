// What every layer needs to know about a track without naming one. The registry (registry.h) lists
// all.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/policy/layout.h"
#include "protocol/tracks/episode_facts.h"

namespace myograde {

// A part of the rules that is easier to read as a table.
struct RulesTable {
  std::string key;      // JSON pointer to the part
  std::string summary;  // a short summary of it
  std::string title;
  std::string note;     // units
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;  // each as long as `head`
};

// One object per track, alive for the whole program; compared by address.
struct TrackKind {
  std::string_view name;        // in configs, JSON, messages and logs
  double control_period_s = 0;  // simulated s per control step
  const TrackLayout& (*layout)() = nullptr;  // of observations and actions
  TrackFacts no_facts;          // the facts of an episode in which nothing was measured
  // Control steps of the longest episode under a config's "rules". InvalidArgumentError if they
  // don't say.
  absl::StatusOr<int64_t> (*max_steps)(const nlohmann::json& rules) = nullptr;
  // Tables of a config's "rules"; null if there are none.
  std::vector<RulesTable> (*tables)(const nlohmann::json& rules) = nullptr;
  int template_year = 0;  // of the MyoChallenge whose agent template has it; 0: none has
};

// TrackKind::max_steps for a track whose rules have the key "max_steps".
absl::StatusOr<int64_t> MaxStepsKey(const nlohmann::json& rules);

inline const VectorLayout& ObservationOf(const TrackKind& kind) {
  return kind.layout().observation;
}
inline const VectorLayout& ExtraOf(const TrackKind& kind) { return kind.layout().extra; }
inline const VectorLayout& ActionOf(const TrackKind& kind) { return kind.layout().action; }

}  // namespace myograde
