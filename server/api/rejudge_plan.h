// From an organiser's request to a rejudge: which board, which config it would have, and the signed
// documents of what was done, by which rules, why, and with which results.
#pragma once

#include <optional>

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

// A rejudge of a board from one config to another, of the purpose and method that are usual.
NewRejudge RejudgeBetween(const TrackConfig& from, const TrackConfig& to);

// What the store is to create. InvalidArgumentError says in one sentence what is wrong with the
// config, or how it does not fit the board.
absl::StatusOr<NewRejudge> MakeRejudge(const Transaction& reader, const ApiContext& context,
                                       const RejudgeRequest& request);

// Signs the document of the act that the store is about to write, with the key of receipts. An
// error if there is no key.
absl::StatusOr<SignDocument> RejudgeSigner(const ApiContext& context);

}  // namespace myograde::server
