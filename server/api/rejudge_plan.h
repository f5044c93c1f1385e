// From an organiser's request to a rejudge: which board, which config it would have, and the signed
// documents of what was done, by which rules, why, and with which results.
#pragma once

#include <optional>
#include <set>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/grading/tracks.h"
#include "server/store/rejudges.h"

namespace myograde::server {

// The body of POST /v1/rejudges: either a phase, or a track with a profile ("": its own), method,
// repeats and why; and the content of a track config's file.
struct RejudgeRequest : RejudgeRow {
  std::optional<nlohmann::json> config;
};
// InvalidArgumentError names the key and says what is allowed.
absl::StatusOr<RejudgeRequest> ParseRejudge(const nlohmann::json& body);

// The reason and the submissions without result of the body of POST /v1/rejudges/ID/apply.
absl::StatusOr<RejudgeAct> ParseApply(const nlohmann::json& body);

// What a board is played and judged by now. Of a phase, only its name counts.
absl::StatusOr<TrackPtr> TrackInForce(const Transaction& reader, const ApiContext& context,
                                      const BoardName& board);

// A rejudge of a board from one config to another, of the purpose and method that are usual.
NewRejudge RejudgeBetween(const TrackConfig& from, const TrackConfig& to);

// What the store is to create. InvalidArgumentError says in one sentence what is wrong with the
// config, or how it does not fit the board.
absl::StatusOr<NewRejudge> MakeRejudge(const Transaction& reader, const ApiContext& context,
                                       const RejudgeRequest& request);

// The JSON pointers at which two effective configs differ; `at` is that of the two. What one lacks
// counts as an empty object, so what only one has is told key by key; a list is one value.
std::set<std::string> DifferingKeys(const nlohmann::json& from, const nlohmann::json& to,
                                    const std::string& at = "");

// Signs the document of the act that the store is about to write, with the key of receipts. An
// error if there is no key.
absl::StatusOr<SignDocument> RejudgeSigner(const ApiContext& context);

}  // namespace myograde::server
