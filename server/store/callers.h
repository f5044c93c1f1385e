// Who calls, in the store.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

// Different kinds of denied requests that have rows of their own, for each UTC day.
inline constexpr int64_t kMostDenialsOfADay = 1000;

// Who calls: bearer tokens, what was denied, and the acts of organisers and operators.
class Callers : StorePart {
 public:
  using StorePart::StorePart;

  // By the SHA-256 of its text, whether it is valid or not.
  absl::StatusOr<TokenRow> TokenByHash(const std::string& sha256) const;
  absl::StatusOr<TokenRow> Token(int64_t id) const;
  // Newest first; `before` is an id.
  Listed<TokenRow> Tokens(int64_t before = INT64_MAX, int64_t limit = INT64_MAX) const;
  // Newest first. `kind` "" matches any; `before` is an id.
  Listed<AccessEventRow> Events(const std::string& kind, int64_t before, int64_t limit) const;
  // As of now, by the SHA-256 of its text; of `token`, only role, team, label and expires_at are used.
  // InvalidArgumentError for a role that does not fit the team, or a time in the past.
  absl::StatusOr<int64_t> AddToken(const std::string& sha256, const TokenRow& token,
                                   const std::string& who);
  absl::StatusOr<bool> RevokeToken(int64_t id, const std::string& who);
  // Notes that it was used now. Writes at most once a minute.
  absl::Status TouchToken(int64_t id);
  // Counts denied requests in today's row of equal ones. Once today has kMostDenialsOfADay rows,
  // new kinds count in that of `others`.
  absl::Status AddDenial(AccessEventRow event, const AccessEventRow& others);
  // Removes denials of before, some thousands at a time.
  void RemoveDenials(int64_t before_ms);
  // Adds an act, as of now; `event.id` and `event.at` are ignored.
  absl::Status AddEvent(const AccessEventRow& event);
};

}  // namespace myograde::server
