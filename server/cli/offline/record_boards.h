// The boards that follow from a public record and its receipts.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/track.h"
#include "server/board/board_state.h"
#include "server/store/rows.h"

namespace myograde::server {

// What boards need of a receipt that holds.
struct ReceivedResult {
  bool done = false;  // a failed one is on no board
  bool hides_seeds = false;
  std::string name;   // of the artefact
  nlohmann::json aggregate;
};

// A config as far as boards need it; "seeds" and what they follow from may be missing.
struct RecordedConfig {
  nlohmann::json config;
  scoring::TrackScoring scoring;
};

// InvalidArgumentError if it can't be read.
absl::StatusOr<RecordedConfig> ReadRecordedConfig(const nlohmann::json& config);

// The numbers of a receipt's episodes, recomputed, not those in it. InvalidArgumentError if
// the receipt has others.
absl::StatusOr<ReceivedResult> ResultOfReceipt(const nlohmann::json& receipt);

// The text of boards/HASH.BOARD.json, as it must be. UnavailableError: it is unknown, as an
// evaluation that may be on it has no receipt.
absl::StatusOr<std::string> BoardText(const BoardState& record,
                                      const std::map<int64_t, ReceivedResult>& results,
                                      const std::string& hash, const RecordedConfig& config,
                                      const std::string& board);

// How a board differs from the one that the record implies, in one sentence: "its
// /rows/1/rank is ...".
std::string FirstDifference(const std::string& found, const std::string& expected);

}  // namespace myograde::server
