// Rejudges as JSON: how far they are, and what they change.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/store/reader.h"
#include "server/store/rejudges.h"

namespace myograde::server {

// What lists and answers have of a rejudge.
absl::StatusOr<nlohmann::json> RejudgeToJson(Reader& reader, const RejudgeRow& rejudge);

// The same with its events, the submissions without result, and where its configs differ.
absl::StatusOr<nlohmann::json> WholeRejudgeToJson(Reader& reader, const RejudgeRow& rejudge);

// Adds "boards" and "not_repeatable": each board of its track before and after, row by row. Of an
// applied one that is as of its application; otherwise as if it were applied now.
absl::Status AddRejudgeChanges(Reader& reader, const RejudgeRow& rejudge, nlohmann::json& json);

}  // namespace myograde::server
