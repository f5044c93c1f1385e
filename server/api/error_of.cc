#include "server/api/error_of.h"

#include <string>

#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "server/api/caller.h"
#include "server/base/log_line.h"
#include "server/store/damage.h"
#include "server/store/reader_pool.h"

namespace myograde::server {
namespace {

constexpr char kRetryKey[] = "myograde/retry_after_s";

}  // namespace

ApiError ErrorOf(const absl::Status& status) {
  const std::string message(status.message());
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
  if (const auto retry = status.GetPayload(kRetryKey); retry.has_value()) {
    return {503, code, message, std::stoll(std::string(*retry))};
  }
  if (code == kKeyReusedCode) return {422, code, message};
  if (code == kBannedCode || code == kForbiddenCode) return {403, code, message};
  const auto code_or = [&code](const char* usual) { return code.empty() ? usual : code; };
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
      return {400, code_or("bad_request"), message};
    case absl::StatusCode::kNotFound:
      // With a code, it is not the resource that is missing, but something that the request names.
      return {code.empty() ? 404 : 400, code_or("not_found"), message};
    case absl::StatusCode::kFailedPrecondition:
      return {409, code_or("conflict"), message};
    case absl::StatusCode::kCancelled:
      return {503, "stopping", message};
    case absl::StatusCode::kDeadlineExceeded:
      return {504, "deadline", message};
    case absl::StatusCode::kUnavailable:
      return {503, code_or("store"), message};
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kDataLoss:
      return {503, "store", message};
    default:
      return {500, "internal", message};
  }
}

absl::Status Busy(std::string_view message, int64_t retry_after_s) {
  absl::Status status =
      WithErrorCode(absl::UnavailableError({message.data(), message.size()}), "busy");
  status.SetPayload(kRetryKey, absl::Cord(absl::StrCat(retry_after_s)));
  return status;
}

absl::Status TeamErrorOf(const absl::Status& status, const std::string& team) {
  const std::string other = ResembledTeam(status);
  if (other.empty()) return status;
  const LogScope scope({.team = team});
  spdlog::info("a team \"{}\" was refused: it looks like team \"{}\"", team, other);
  if (!CallerIsOrganiser()) return status;
  return WithErrorCode(
      absl::Status(status.code(),
                   absl::StrCat("the team's name looks like that of team \"", other,
                                "\"; choose another name, or write that one exactly as it stands here")),
      ErrorCodeOf(status));
}

}  // namespace myograde::server
