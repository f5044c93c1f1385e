// Checks of what clients send. Every mistake is an InvalidArgumentError that
// names the key and says what is allowed.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "server/admission/admission.h"
#include "server/http/request.h"
#include "server/store/submissions.h"

namespace myograde::server {

// The text at "reason", which is required.
std::string ReadReason(ConfigReader& reader);

absl::StatusOr<SubmitRequest> ParseSubmit(const nlohmann::json& body);

struct RerunRequest {
  std::optional<int64_t> first;
  std::optional<int64_t> last;
};
absl::StatusOr<RerunRequest> ParseRerun(const nlohmann::json& body);

// The reason given, or the usual one.
absl::StatusOr<std::string> ParseCancel(const nlohmann::json& body);

// The reason of an organiser's act: {"reason": "…"}.
absl::StatusOr<std::string> ParseReason(const nlohmann::json& body);

// {}: no keys.
absl::Status ParseNothing(const nlohmann::json& body);

absl::StatusOr<NewGrant> ParseGrant(const nlohmann::json& body);

// The header Idempotency-Key, with a digest of the address and the body; no key without one.
absl::StatusOr<RequestKey> ReadRequestKey(const Request& request, const nlohmann::json& body);

// Whether there can be a team of this name; what a new one may be called is stricter
// and the store's to say (Teams::Check), as teams of long ago keep their names.
absl::Status CheckTeam(const std::string& team);

// Whole numbers of a query; a missing parameter leaves `value` as it is.
absl::Status ReadNumber(const Request& request, const char* key, int64_t max, int64_t& value,
                        int64_t min = 1);

// "true" or "false"; false if it is missing.
absl::StatusOr<bool> ReadFlag(const Request& request, const char* key);

// "1" or "0"; `fallback` if it is missing or empty.
absl::StatusOr<bool> ReadSwitch(const Request& request, const char* key, bool fallback);

absl::StatusOr<SubmissionFilter> ParseFilter(const Request& request);

// `known` are all of the parameters that an address has.
absl::Status CheckParameters(const Request& request, const std::vector<std::string>& known);

// Lists come in pages, newest first: every list has the parameters `limit` and `before`, and tells
// where the next page begins (AddNextPage of views.h).
struct Page {
  int64_t before = std::numeric_limits<int64_t>::max();  // only ids below
  int64_t limit = 100;                                   // so many rows at most
};

// The page that a request asks for; `others` are the parameters that its address has beside those
// of pages.
absl::StatusOr<Page> ReadPage(const Request& request, std::vector<std::string> others = {});

// The number in a path like /v1/submissions/ID. REQUIRES: the pattern's first group is 1 to 18
// digits.
int64_t ReadId(const Request& request);

}  // namespace myograde::server
