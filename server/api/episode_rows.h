// The rows of episodes in an answer about an evaluation: which of them, whole or as columns, and
// what their details come to together.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/aggregate.h"
#include "server/grading/tracks.h"
#include "server/http/request.h"
#include "server/store/rows.h"

namespace myograde::server {

// What a request asks for.
struct EpisodeSelection {
  bool rows = false;  // of the episodes from `first` to `last`
  int64_t first = 0;
  int64_t last = std::numeric_limits<int64_t>::max();
  // Keys of rows, of which columns are made: "outcome", or "facts.course" for a key within one.
  // Empty: whole rows.
  std::vector<std::string> fields;
  bool details = true;   // whole rows have their details
  bool summary = false;  // AddSummary

  bool needs_details() const;
};

// The parameters "details", "episodes", "fields", "first", "last" and "summary".
// InvalidArgumentError: one has a value that it can't have, or there is another one.
absl::StatusOr<EpisodeSelection> ParseEpisodes(const Request& request);

// Those of `rows` that are asked for, whole.
nlohmann::json RowsToJson(const std::vector<EpisodeRow>& rows, const std::string& seed_salt,
                          const EpisodeSelection& selection);

// Whole rows as columns: {"index": [0, 1], "facts.course": [2, null]}, with "index" and the fields.
// A value that a row lacks is null.
nlohmann::json ColumnsOf(const std::vector<std::string>& fields, const nlohmann::json& rows);

// Adds "details_summary" and "highlights" of all `rows`, which have their details, to the answer
// about their evaluation. `judged` are the same episodes in the same order. Errors of
// EpisodesInOrder.
absl::Status AddSummary(const Track& track, const std::vector<EpisodeRow>& rows,
                        const std::vector<scoring::JudgedEpisode>& judged, nlohmann::json& json);

// Adds up the details of episodes, whatever their track, each with its steps: {"episodes", "steps",
// "values"}, where `values` has the shape of the details, with {"count", "min", "mean", "max"} in
// the place of each number. Of numbers that no episode has, all but the count are null. An episode
// whose details are null does not count; null if none does.
nlohmann::json SummaryOf(const std::vector<std::pair<nlohmann::json, int64_t>>& episodes);

}  // namespace myograde::server
