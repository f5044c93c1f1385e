// What every layer has to know of a track, so that none of them names one. The registry
// (registry.h) lists all.
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

// A part of the rules that people read better as a table.
struct RulesTable {
  std::string key;      // JSON pointer of the part
  std::string summary;  // of it, in a word or a few
  std::string title;
  std::string note;     // units
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;  // each as long as `head`
};

// One object for each track, there for the program's life; compared by address.
struct TrackKind {
  std::string_view name;        // in configs, JSON, messages and logs
  double control_period_s = 0;  // simulated time of a control step
  const TrackLayout& (*layout)() = nullptr;  // of observations and actions
  TrackFacts no_facts;          // those of an episode in which nothing was measured
  // Control steps of the longest episode under a config's "rules". InvalidArgumentError if they
  // don't tell.
  absl::StatusOr<int64_t> (*max_steps)(const nlohmann::json& rules) = nullptr;
  // Tables of a config's "rules"; null if there are none.
  std::vector<RulesTable> (*tables)(const nlohmann::json& rules) = nullptr;
  // Takes an effective config from a form to the next (protocol/lease/track_config_forms.h): gives
  // the track's own new keys the values that say what the earlier form meant. Null: it has none.
  void (*upgrade)(int64_t form, nlohmann::json& config) = nullptr;
};

// TrackKind::max_steps of a track whose rules have it as the key "max_steps".
absl::StatusOr<int64_t> MaxStepsKey(const nlohmann::json& rules);

inline const VectorLayout& ObservationOf(const TrackKind& kind) {
  return kind.layout().observation;
}
inline const VectorLayout& ActionOf(const TrackKind& kind) { return kind.layout().action; }

}  // namespace myograde
