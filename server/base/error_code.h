// The API's error codes, where the code of a status does not tell enough.
#pragma once

#include <string>
#include <string_view>

#include <absl/status/status.h>

namespace myograde::server {

// Things that a team or a person may not do.
inline constexpr char kBannedCode[] = "banned";
inline constexpr char kForbiddenCode[] = "forbidden";
// An artefact whose last evaluations all ended by the grader's fault.
inline constexpr char kHeldBackCode[] = "held_back";
// An Idempotency-Key that came with another request before.
inline constexpr char kKeyReusedCode[] = "idempotency_mismatch";
// A row of the store that can't be read (server/store/damage.h).
inline constexpr char kDamagedRowCode[] = "damaged_row";

inline constexpr char kErrorCodePayload[] = "myograde/error-code";

// Attaches a code to a status.
inline absl::Status WithErrorCode(absl::Status status, std::string_view code) {
  status.SetPayload(kErrorCodePayload, absl::Cord(std::string(code)));
  return status;
}
// A FailedPreconditionError with a code.
inline absl::Status CodedRefusal(std::string_view code, const std::string& sentence) {
  return WithErrorCode(absl::FailedPreconditionError(sentence), code);
}
// "" if it has none.
inline std::string ErrorCodeOf(const absl::Status& status) {
  return std::string(status.GetPayload(kErrorCodePayload).value_or(absl::Cord()));
}

}  // namespace myograde::server
