// The registry of the scored tracks: what each is judged and ranked by.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/board.h"
#include "scoring/metric.h"
#include "scoring/verdict.h"

namespace myograde::scoring {

// The board that every track has.
inline constexpr char kMainBoard[] = "main";

struct TrackScoring;

// What scoring has of a track; its folder is scoring/<track>/. One object for each, there for the
// program's life.
struct ScoredTrack {
  std::string_view name;            // as in protocol/tracks
  std::span<const Metric> metrics;  // in the order of Verdict::metrics
  // Keys that results of this track have always had beside its metrics, with null: of an episode,
  // of an evaluation's means and of their spreads. They stay, as results are compared by their
  // bytes.
  std::span<const std::string_view> null_metrics;
  std::span<const std::string_view> null_means;
  std::span<const std::string_view> null_spreads;
  // Reads the `scoring` section of a config. `where` names it in errors; unknown keys are errors.
  absl::StatusOr<TrackScoring> (*parse)(const nlohmann::json& scoring, const std::string& where);
};

struct BoardSpec {
  BoardRules rules;
  std::vector<size_t> columns;  // places of the metrics that it shows beside the successes
};

// The `scoring` section of a track config.
struct TrackScoring {
  const ScoredTrack* track = nullptr;
  // The verdict on an episode by these rules.
  std::function<Verdict(const EpisodeFacts&)> judge;
  TeamRule team = TeamRule::kBest;
  std::map<std::string, BoardSpec> boards;  // by name; one is kMainBoard
  // The profile reports what the official code reports, so that its figures are for comparing
  // with those that were published of it.
  bool official_figures = false;
};

std::span<const ScoredTrack* const> ScoredTracks();

// nullptr if there is none of that name.
const ScoredTrack* FindScoredTrack(std::string_view name);

// The place of a ranked metric among the numbers of a BoardEntry. REQUIRES: it is ranked.
size_t RankedPlace(std::span<const Metric> metrics, size_t metric);

}  // namespace myograde::scoring
