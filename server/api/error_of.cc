#include "server/api/error_of.h"

#include <string>
#include <vector>

#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <spdlog/spdlog.h>

#include "server/api/caller.h"
#include "server/base/log_line.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/reader.h"

namespace myograde::server {
namespace {

// Of a status's payload: the HTTP status, the seconds of Retry-After and the code.
constexpr char kErrorForm[] = "myograde/error";

}  // namespace

ApiError ErrorOf(const absl::Status& status) {
  const std::string message(status.message());
  if (const auto form = status.GetPayload(kErrorForm); form.has_value()) {
    const std::vector<std::string> parts = absl::StrSplit(std::string(*form), ' ');
    return {std::stoi(parts[0]), parts[2], message, std::stoll(parts[1])};
  }
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
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

absl::Status StatusOf(const ApiError& error) {
  absl::Status status = absl::UnknownError(error.message);
  status.SetPayload(kErrorForm, absl::Cord(absl::StrCat(error.http, " ", error.retry_after_s, " ",
                                                        error.code)));
  return status;
}

absl::Status TeamErrorOf(const absl::Status& status, const std::string& team) {
  const std::string other = ResembledTeam(status);
  if (other.empty()) return status;
  const LogScope scope({.team = team});
  spdlog::info("a team \"{}\" was refused: it looks like team \"{}\"", team, other);
  if (!CallerIsOrganiser()) return status;
  ApiError error = ErrorOf(status);
  error.message = absl::StrCat("the team's name looks like that of team \"", other,
                               "\"; choose another name, or write that one exactly as it stands here");
  return StatusOf(error);
}

}  // namespace myograde::server
