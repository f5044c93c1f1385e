#include "server/api/routes.h"

#include <utility>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/api/negotiation.h"
#include "server/api/resources.h"
#include "server/base/error_code.h"
#include "server/base/log_line.h"
#include "server/http/http_server.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

constexpr char kRetryKey[] = "myograde/retry_after_s";

// Messages about the host's trouble name its files, which is nothing for strangers.
std::string MessageFor(const ApiError& error) {
  if (CallerIsOrganiser() || !HttpServer::RequestConnection().Asker().network) {
    return error.message;
  }
  if (error.code == "store") {
    return "the server's store can't be read or written at the moment; nothing was changed; try "
           "again later, and tell the organisers if this persists";
  }
  if (error.code == "internal") {
    return "the server failed; its log has the reason, for the organisers";
  }
  return error.message;
}

void SendError(Response& response, ApiError error) {
  if (error.http >= 500) spdlog::warn("answered {}: {}", error.http, error.message);
  error.message = MessageFor(error);
  response.SetError(error);
}

void SendResult(const Request& request, Response& response, const ApiResult& result) {
  if (!result.ok()) return SendError(response, ToApiError(result.status()));
  const ApiAnswer& answer = *result;
  if (!answer.next.empty()) {
    response.SetHeader("Link", absl::StrCat("<", answer.next, ">; rel=\"next\""));
  }
  // A page of another origin has its reader's network but none of their tokens.
  const bool anonymous = Caller().remote && Caller().token == 0;
  if (answer.for_all_origins && anonymous) {
    response.SetHeader("Access-Control-Allow-Origin", "*");
  }
  std::string text =
      answer.text == nullptr ? CanonicalJson(answer.body) + "\n" : *answer.text;
  if (!answer.tagged) return response.SetJson(answer.http, std::move(text));
  // It may be kept, as long as its holder asks each time whether it is still current.
  response.SetHeader("Cache-Control", "no-cache");
  response.SetHeader("Vary", "Authorization");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  if (AnswersWithTag(request, ComputeEntityTag(text), response)) return;
  response.status = answer.http;
  response.SetContent(std::move(text), "application/json");
}

// Counts the request that a response is to, when what is returned goes.
auto CountAtEnd(Metrics& metrics, std::string_view action, const Response& response) {
  return absl::Cleanup([&metrics, &response, action, begin = SystemClock().Monotonic()] {
    metrics.ObserveRequest(action, response.status, SystemClock().Monotonic() - begin);
  });
}

}  // namespace

ApiError ToApiError(const absl::Status& status) {
  const std::string message(status.message());
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
  if (const auto retry = status.GetPayload(kRetryKey); retry.has_value()) {
    return {503, code, message, std::stoll(std::string(*retry))};
  }
  if (code == kKeyReusedCode) return {422, code, message};
  if (code == kBannedCode || code == kForbiddenCode) return {403, code, message};
  const auto code_or = [&code](const char* fallback) { return code.empty() ? fallback : code; };
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

absl::Status ToTeamError(const absl::Status& status, const std::string& team) {
  const std::string other = ResembledTeam(status);
  if (other.empty()) return status;
  const LogScope scope({.team = team});
  spdlog::info("refused a team \"{}\": its name looks like \"{}\"", team, other);
  if (!CallerIsOrganiser()) return status;
  return WithErrorCode(
      absl::Status(status.code(),
                   absl::StrCat("the team's name looks like that of team \"", other,
                                "\"; choose another name, or write that name exactly as shown "
                                "here")),
      ErrorCodeOf(status));
}

Routes::Routes(Router& router, Guard& guard, const ApiContext& context)
    : router_(router), guard_(guard), context_(context) {
  router.SetUnknown([&](const Request& request, Response& response) {
    const auto count = CountAtEnd(context.metrics, "none", response);
    if (auto over = guard.AdmitUnknown(HttpServer::RequestConnection())) {
      return SendError(response, *std::move(over));
    }
    ApiError why = router.WhyNone(request);
    if (why.http == 404 && ServeUnknownPage(request, response)) return;
    if (request.method != "OPTIONS" || why.http != 405) return SendError(response, std::move(why));
    response.status = 204;
    response.SetHeader("Allow", why.allow);
  });
}

// The address serves those who may take its action at all.
void Routes::Add(Address address) {
  address.serve = [&context = context_, &guard = guard_, action = address.action,
                   serve = std::move(address.serve)](const Request& request, Response& response) {
    const auto count = CountAtEnd(context.metrics, ActionName(action), response);
    Identity who;
    if (auto refusal = guard.Admit(HttpServer::RequestConnection(), action, who)) {
      return SendError(response, *std::move(refusal));
    }
    CallerScope scope(who, action, context.access_log);
    try {
      serve(request, response);
    } catch (const std::exception& error) {
      SendError(response, {500, "internal", absl::StrCat(request.method, " ", request.path,
                                                         " failed in the server: ", error.what())});
    }
    scope.Finish(request.method, request.path, response.status);
  };
  router_.Add(std::move(address));
}

void Routes::Get(const std::string& pattern, Action action, Handler handler) {
  Add({"GET", pattern, action, [handler = std::move(handler)](const Request& request, Response& response) {
         SendResult(request, response, handler(request));
       }});
}

void Routes::GetFile(const std::string& pattern, Action action, FileHandler handler) {
  Add({"GET", pattern, action, [handler = std::move(handler)](const Request& request, Response& response) {
         const absl::Status status = handler(request, response);
         if (!status.ok()) SendError(response, ToApiError(status));
       }});
}

void Routes::GetPage(const std::string& path,
                     std::function<void(const Request&, Response&)> handler) {
  Add({"GET", absl::StrReplaceAll(path, {{".", "[.]"}}), Action::kReadApi, std::move(handler),
       BodyRule(), /*page=*/true});
}

void Routes::Post(const std::string& pattern, Action action, JsonHandler handler) {
  PostUpload(pattern, action, BodyRule(),
             [handler = std::move(handler)](const Request& request) -> ApiResult {
               ASSIGN_OR_RETURN(const std::string body, request.body->Text());
               ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(body, "request"));
               return handler(request, json);
             });
}

void Routes::PostUpload(const std::string& path, Action action, BodyRule rule, Handler handler) {
  Add({"POST", path, action,
       [handler = std::move(handler)](const Request& request, Response& response) {
         SendResult(request, response, handler(request));
       },
       std::move(rule)});
}

}  // namespace myograde::server
