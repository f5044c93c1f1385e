#include "server/api/routes.h"

#include <exception>
#include <set>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "server/api/entity_tag.h"
#include "server/base/peer_key.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/reader.h"

namespace myograde::server {
namespace {

constexpr char kJson[] = "application/json";

// Most answers are for their caller alone, or hold only for a moment.
void SendText(httplib::Response& response, int http, const std::string& text) {
  response.status = http;
  response.set_header("Cache-Control", "no-store");
  response.set_content(text, kJson);
}

void SendError(httplib::Response& response, const ApiError& error) {
  if (error.http == 429 || error.http == 503) response.set_header("Retry-After", "1");
  if (error.http >= 500) spdlog::warn("answered {}: {}", error.http, error.message);
  const nlohmann::json body = {{"error", {{"code", error.code}, {"message", error.message}}}};
  SendText(response, error.http, CanonicalJson(body) + "\n");
}

// Sends a text that may be kept, as long as its holder asks each time whether it is still current.
void SendTagged(const httplib::Request& request, httplib::Response& response, int http,
                const std::string& text) {
  const std::string tag = EntityTagOf(text);
  response.set_header("ETag", tag);
  response.set_header("Cache-Control", "no-cache");
  response.set_header("Vary", "Authorization");
  for (size_t i = 0; i < request.get_header_value_count("If-None-Match"); ++i) {
    if (!NamesEntityTag(request.get_header_value("If-None-Match", i), tag)) continue;
    response.status = 304;
    return;
  }
  response.status = http;
  response.set_content(text, kJson);
}

void SendResult(const httplib::Request& request, httplib::Response& response,
                const ApiResult& result) {
  if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
  const auto& answer = std::get<ApiAnswer>(result);
  if (!answer.next.empty()) {
    response.set_header("Link", absl::StrCat("<", answer.next, ">; rel=\"next\""));
  }
  const std::string text =
      answer.text == nullptr ? CanonicalJson(answer.body) + "\n" : *answer.text;
  if (answer.tagged) return SendTagged(request, response, answer.http, text);
  SendText(response, answer.http, text);
}

// Whatever cpp-httplib did not give to a handler: a method that the address lacks or that nobody
// knows, an address that is not there, a head that it could not read.
void SendUnrouted(const Methods& methods, const httplib::Request& request,
                  httplib::Response& response) {
  // The path is not there yet if the method is unknown.
  const std::string path =
      request.path.empty() ? request.target.substr(0, request.target.find('?')) : request.path;
  const std::set<std::string> allowed = methods.At(path);
  if (!allowed.empty()) response.set_header("Allow", absl::StrJoin(allowed, ", "));
  if (request.method == "OPTIONS" && !allowed.empty()) {
    response.status = 204;
    return;
  }
  if (!allowed.empty() && !allowed.contains(request.method)) {
    return SendError(response, {405, "method_not_allowed",
                                absl::StrCat(path, " has no ", request.method, "; it has ",
                                             absl::StrJoin(allowed, ", "))});
  }
  const char* code = response.status == 413   ? "too_large"
                     : response.status == 404 ? "not_found"
                                              : "bad_request";
  SendError(response, {response.status, code,
                       absl::StrCat("there is no ", request.method, " ", path,
                                    ", or the request is malformed; see the API's description")});
}

}  // namespace

ApiError ErrorOf(const absl::Status& status) {
  const std::string message(status.message());
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
  if (code == kKeyReusedCode) return {422, code, message};
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

std::string CallerKey() { return PeerKey(UnixHttpServer::PeerUid()); }

std::optional<ApiError> OnlyOrganiser() {
  if (UnixHttpServer::PeerIsOrganiser()) return std::nullopt;
  return ApiError{403, "forbidden", "only root and the user that runs the daemon may do this"};
}

void Routes::Get(const std::string& pattern, Handler handler) {
  methods_.Add("GET", pattern);
  server_.Get(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                      httplib::Response& response) {
    SendResult(request, response, handler(request));
  });
}

void Routes::GetFile(const std::string& pattern, FileHandler handler) {
  methods_.Add("GET", pattern);
  server_.Get(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                      httplib::Response& response) {
    if (const auto error = handler(request, response)) SendError(response, *error);
  });
}

// The body is there as a whole, within its limits; cpp-httplib would take it for a form, if it is
// called one.
void Routes::Post(const std::string& pattern, JsonHandler handler) {
  methods_.Add("POST", pattern);
  server_.Post(pattern, [handler = std::move(handler)](const httplib::Request& request,
                                                       httplib::Response& response,
                                                       const httplib::ContentReader&) {
    const absl::StatusOr<std::string> body = UnixHttpServer::RequestBody().Text();
    if (!body.ok()) return SendError(response, ErrorOf(body.status()));
    const absl::StatusOr<nlohmann::json> json = ParseJson(*body, "request");
    if (!json.ok()) return SendError(response, ErrorOf(json.status()));
    SendResult(request, response, handler(request, *json));
  });
}

void Routes::PostUpload(const std::string& path, BodyRule rule, Handler handler) {
  methods_.Add("POST", path);
  server_.SetBodyRule(path, std::move(rule));
  server_.Post(path, [handler = std::move(handler)](const httplib::Request& request,
                                                    httplib::Response& response,
                                                    const httplib::ContentReader&) {
    SendResult(request, response, handler(request));
  });
}

void Routes::AddErrorAnswers() {
  server_.set_error_handler(
      [methods = std::move(methods_)](const httplib::Request& request, httplib::Response& response) {
        if (response.body.empty()) SendUnrouted(methods, request, response);
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
