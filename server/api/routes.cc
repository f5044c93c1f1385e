#include "server/api/routes.h"

#include <exception>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/reader.h"

namespace myograde::server {
namespace {

constexpr char kJson[] = "application/json";

void SendJson(httplib::Response& response, int http, const nlohmann::json& body) {
  response.status = http;
  response.set_content(CanonicalJson(body) + "\n", kJson);
}

void SendError(httplib::Response& response, const ApiError& error) {
  if (error.http == 429 || error.http == 503) response.set_header("Retry-After", "1");
  if (error.http >= 500) spdlog::warn("answered {}: {}", error.http, error.message);
  SendJson(response, error.http, {{"error", {{"code", error.code}, {"message", error.message}}}});
}

void SendResult(httplib::Response& response, const ApiResult& result) {
  if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
  const auto& answer = std::get<ApiAnswer>(result);
  if (answer.text == nullptr) return SendJson(response, answer.http, answer.body);
  response.status = answer.http;
  response.set_content(*answer.text, kJson);
}

}  // namespace

ApiError ErrorOf(const absl::Status& status) {
  const std::string message(status.message());
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
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

ApiError TeamErrorOf(const absl::Status& status, const std::string& team) {
  ApiError error = ErrorOf(status);
  const std::string other = ResembledTeam(status);
  if (other.empty()) return error;
  spdlog::info("a team \"{}\" was refused: it looks like team \"{}\"", team, other);
  if (!OnlyOrganiser().has_value()) {
    error.message = absl::StrCat("the team's name looks like that of team \"", other,
                                 "\"; choose another name, or write that one exactly as it stands "
                                 "here");
  }
  return error;
}

std::string CallerKey() { return UnixHttpServer::Caller().key; }

std::optional<ApiError> OnlyOrganiser() {
  if (UnixHttpServer::PeerIsOrganiser()) return std::nullopt;
  return ApiError{403, "forbidden", "only root and the user that runs the daemon may do this"};
}

void Routes::Get(const std::string& pattern, Handler handler) {
  server_.Get(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                      httplib::Response& response) {
    SendResult(response, handler(request));
  });
}

void Routes::GetFile(const std::string& pattern, FileHandler handler) {
  server_.Get(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                      httplib::Response& response) {
    if (const auto error = handler(request, response)) SendError(response, *error);
  });
}

// The body is there as a whole, within its limits; cpp-httplib would take it for a form, if it is
// called one.
void Routes::Post(const std::string& pattern, JsonHandler handler) {
  server_.Post(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                       httplib::Response& response,
                                                       const httplib::ContentReader&) {
    const absl::StatusOr<std::string> body = UnixHttpServer::RequestBody().Text();
    if (!body.ok()) return SendError(response, ErrorOf(body.status()));
    const absl::StatusOr<nlohmann::json> json = ParseJson(*body, "request");
    if (!json.ok()) return SendError(response, ErrorOf(json.status()));
    SendResult(response, handler(request, *json));
  });
}

void Routes::PostUpload(const std::string& path, BodyRule rule, Handler handler) {
  server_.SetBodyRule(path, std::move(rule));
  server_.Post(path, [handler = std::move(handler)](const httplib::Request& request,
                                                    httplib::Response& response,
                                                    const httplib::ContentReader&) {
    SendResult(response, handler(request));
  });
}

void Routes::AddErrorAnswers() {
  server_.set_error_handler([](const httplib::Request& request, httplib::Response& response) {
    if (!response.body.empty()) return;  // ours
    const char* code = response.status == 413 ? "too_large"
                       : response.status == 404 ? "not_found" : "bad_request";
    SendError(response, {response.status, code,
                         absl::StrCat("there is no ", request.method, " ", request.path,
                                      ", or the request is malformed; see the API's description")});
  });
  server_.set_exception_handler([](const httplib::Request& request, httplib::Response& response,
                                   std::exception_ptr thrown) {
    std::string what = "unknown";
    try {
      std::rethrow_exception(thrown);
    } catch (const std::exception& error) {
      what = error.what();
    } catch (...) {
    }
    SendError(response, {500, "internal", absl::StrCat(request.method, " ", request.path,
                                                       " failed in the server: ", what)});
  });
}

}  // namespace myograde::server
