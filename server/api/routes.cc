#include "server/api/routes.h"

#include <exception>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"

namespace myograde::server {
namespace {

constexpr char kJson[] = "application/json";

void SendJson(httplib::Response& response, int http, const nlohmann::json& body) {
  response.status = http;
  response.set_content(CanonicalJson(body) + "\n", kJson);
}

void SendError(httplib::Response& response, const ApiError& error) {
  if (error.http == 429 || error.http == 503) {
    response.set_header("Retry-After", absl::StrCat(error.retry_after_s));
  }
  if (error.http == 401) response.set_header("WWW-Authenticate", "Bearer");
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

// Runs `serve`, which fills in the response, if the caller may take the action at all.
void ServeIfAdmitted(Guard& guard, Action action, const httplib::Request& request,
                     httplib::Response& response, const std::function<void()>& serve) {
  const auto admitted = guard.Admit(UnixHttpServer::RequestConnection(), action);
  if (const auto* error = std::get_if<ApiError>(&admitted)) return SendError(response, *error);
  CallerScope scope(std::get<Identity>(admitted), action, guard.log());
  response.status = 200;
  serve();
  scope.Finish(request.method, request.path, response.status);
}

}  // namespace

void Routes::Get(const std::string& pattern, Action action, Handler handler) {
  guard_.AddAddress("GET", pattern, action);
  server_.Get(pattern, [&guard = guard_, action, handler = std::move(handler)](
                           const httplib::Request& request, httplib::Response& response) {
    ServeIfAdmitted(guard, action, request, response,
                    [&] { SendResult(response, handler(request)); });
  });
}

void Routes::GetFile(const std::string& pattern, Action action, FileHandler handler) {
  guard_.AddAddress("GET", pattern, action);
  server_.Get(pattern, [&guard = guard_, action, handler = std::move(handler)](
                           const httplib::Request& request, httplib::Response& response) {
    ServeIfAdmitted(guard, action, request, response, [&] {
      if (const auto error = handler(request, response)) SendError(response, *error);
    });
  });
}

// The body is there as a whole, within its limits; cpp-httplib would take it for a form, if it is
// called one.
void Routes::Post(const std::string& pattern, Action action, JsonHandler handler) {
  guard_.AddAddress("POST", pattern, action);
  server_.Post(pattern, [&guard = guard_, action, handler = std::move(handler)](
                            const httplib::Request& request, httplib::Response& response,
                            const httplib::ContentReader&) {
    ServeIfAdmitted(guard, action, request, response, [&] {
      const absl::StatusOr<std::string> body = UnixHttpServer::RequestBody().Text();
      if (!body.ok()) return SendError(response, ErrorOf(body.status()));
      const absl::StatusOr<nlohmann::json> json = ParseJson(*body, "request");
      if (!json.ok()) return SendError(response, ErrorOf(json.status()));
      SendResult(response, handler(request, *json));
    });
  });
}

void Routes::Delete(const std::string& pattern, Action action, Handler handler) {
  guard_.AddAddress("DELETE", pattern, action);
  server_.Delete(pattern, [&guard = guard_, action, handler = std::move(handler)](
                              const httplib::Request& request, httplib::Response& response,
                              const httplib::ContentReader&) {
    ServeIfAdmitted(guard, action, request, response,
                    [&] { SendResult(response, handler(request)); });
  });
}

void Routes::PostUpload(const std::string& path, Action action, BodyRule rule, Handler handler) {
  guard_.AddAddress("POST", path, action);
  server_.SetBodyRule(path, std::move(rule));
  server_.Post(path, [&guard = guard_, action, handler = std::move(handler)](
                         const httplib::Request& request, httplib::Response& response,
                         const httplib::ContentReader&) {
    ServeIfAdmitted(guard, action, request, response,
                    [&] { SendResult(response, handler(request)); });
  });
}

void Routes::AddErrorAnswers() {
  server_.set_error_handler([&guard = guard_](const httplib::Request& request,
                                              httplib::Response& response) {
    if (!response.body.empty()) return;  // ours
    if (const auto over = guard.AdmitUnknown(UnixHttpServer::RequestConnection())) {
      response.status = over->http;
      return SendError(response, *over);
    }
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
