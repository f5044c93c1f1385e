#include "server/api/routes.h"

#include <exception>
#include <set>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_replace.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "server/api/entity_tag.h"
#include "server/api/methods.h"
#include "server/api/negotiation.h"

namespace myograde::server {
namespace {

constexpr char kJson[] = "application/json";

// Most answers are for their caller alone, or hold only for a moment.
void SendText(httplib::Response& response, int http, const std::string& text) {
  response.status = http;
  response.set_header("Cache-Control", "no-store");
  response.set_header("X-Content-Type-Options", "nosniff");
  response.set_content(text, kJson);
}

// Messages about the host's trouble name its files, which is nothing for strangers.
std::string MessageFor(const ApiError& error) {
  if (CallerIsOrganiser() || !UnixHttpServer::RequestConnection().Asker().network) {
    return error.message;
  }
  if (error.code == "store") {
    return "the server's store can't be read or written at the moment, and nothing was changed; try "
           "again later, and tell the organisers if this lasts";
  }
  if (error.code == "internal") return "the server failed; its log tells the organisers why";
  return error.message;
}

void SendError(httplib::Response& response, const ApiError& error) {
  if (error.http == 429 || error.http == 503) {
    response.set_header("Retry-After", absl::StrCat(error.retry_after_s));
  }
  if (error.http == 401) response.set_header("WWW-Authenticate", "Bearer");
  if (error.http >= 500) spdlog::warn("answered {}: {}", error.http, error.message);
  const nlohmann::json body = {{"error", {{"code", error.code}, {"message", MessageFor(error)}}}};
  SendText(response, error.http, CanonicalJson(body) + "\n");
}

// Sends a text that may be kept, as long as its holder asks each time whether it is still current.
void SendTagged(const httplib::Request& request, httplib::Response& response, int http,
                const std::string& text) {
  const std::string tag = EntityTagOf(text);
  response.set_header("ETag", tag);
  response.set_header("Cache-Control", "no-cache");
  response.set_header("Vary", "Authorization");
  response.set_header("X-Content-Type-Options", "nosniff");
  if (HasCurrent(request, tag)) {
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
  // A page of another origin has its reader's network but none of their tokens.
  const bool anonymous = Caller().remote && Caller().token == 0;
  if (answer.for_all_origins && anonymous) {
    response.set_header("Access-Control-Allow-Origin", "*");
  }
  const std::string text =
      answer.text == nullptr ? CanonicalJson(answer.body) + "\n" : *answer.text;
  if (answer.tagged) return SendTagged(request, response, answer.http, text);
  SendText(response, answer.http, text);
}

// Whatever cpp-httplib did not give to a handler: a method that the address lacks or that nobody
// knows, an address that is not there, a head that it could not read.
void SendUnrouted(const std::vector<Address>& addresses, const httplib::Request& request,
                  httplib::Response& response) {
  // The path is not there yet if the method is unknown.
  const std::string path =
      request.path.empty() ? request.target.substr(0, request.target.find('?')) : request.path;
  const std::set<std::string> allowed = MethodsAt(addresses, path);
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
  // cpp-httplib answers 400 to a method that it does not know, wherever it is asked for.
  const int http = allowed.empty() && !path.empty() && response.status == 400 ? 404
                                                                              : response.status;
  const char* code = http == 413 ? "too_large" : http == 404 ? "not_found" : "bad_request";
  SendError(response, {http, code,
                       absl::StrCat("there is no ", request.method, " ", path,
                                    ", or the request is malformed; see the API's description")});
}

// Counts the request that a response is to, when it ends.
class RequestTimer {
 public:
  RequestTimer(Metrics& metrics, std::string_view action, const httplib::Response& response)
      : metrics_(metrics), action_(action), response_(response) {}
  ~RequestTimer() {
    metrics_.ObserveRequest(action_, response_.status, SystemClock().Monotonic() - begin_);
  }
  RequestTimer(const RequestTimer&) = delete;
  RequestTimer& operator=(const RequestTimer&) = delete;

 private:
  Metrics& metrics_;
  const std::string_view action_;
  const httplib::Response& response_;
  const absl::Duration begin_ = SystemClock().Monotonic();
};

// Runs `serve`, which fills in the response, if the caller may take the action at all.
void ServeIfAdmitted(Metrics& metrics, Guard& guard, Action action, const httplib::Request& request,
                     httplib::Response& response, const std::function<void()>& serve) {
  const RequestTimer timer(metrics, ActionName(action), response);
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
  server_.Get(pattern, [&metrics = metrics_, &guard = guard_, action,
                        handler = std::move(handler)](
                           const httplib::Request& request, httplib::Response& response) {
    ServeIfAdmitted(metrics, guard, action, request, response,
                    [&] { SendResult(request, response, handler(request)); });
  });
}

void Routes::GetFile(const std::string& pattern, Action action, FileHandler handler) {
  guard_.AddAddress("GET", pattern, action);
  server_.Get(pattern, [&metrics = metrics_, &guard = guard_, action,
                        handler = std::move(handler)](
                           const httplib::Request& request, httplib::Response& response) {
    ServeIfAdmitted(metrics, guard, action, request, response, [&] {
      if (const auto error = handler(request, response)) SendError(response, *error);
    });
  });
}

void Routes::GetPage(const std::string& path,
                     std::function<void(const httplib::Request&, httplib::Response&)> handler) {
  const std::string pattern = absl::StrReplaceAll(path, {{".", "[.]"}});
  guard_.AddPage(pattern);
  server_.Get(pattern, [&metrics = metrics_, &guard = guard_, handler = std::move(handler)](
                           const httplib::Request& request, httplib::Response& response) {
    ServeIfAdmitted(metrics, guard, Action::kReadApi, request, response,
                    [&] { handler(request, response); });
  });
}

// The body is there as a whole, within its limits; cpp-httplib would take it for a form, if it is
// called one.
void Routes::Post(const std::string& pattern, Action action, JsonHandler handler) {
  guard_.AddAddress("POST", pattern, action);
  server_.Post(pattern, [&metrics = metrics_, &guard = guard_, action,
                        handler = std::move(handler)](
                            const httplib::Request& request, httplib::Response& response,
                            const httplib::ContentReader&) {
    ServeIfAdmitted(metrics, guard, action, request, response, [&] {
      const absl::StatusOr<std::string> body = UnixHttpServer::RequestBody().Text();
      if (!body.ok()) return SendError(response, ErrorOf(body.status()));
      const absl::StatusOr<nlohmann::json> json = ParseJson(*body, "request");
      if (!json.ok()) return SendError(response, ErrorOf(json.status()));
      SendResult(request, response, handler(request, *json));
    });
  });
}

void Routes::Delete(const std::string& pattern, Action action, Handler handler) {
  guard_.AddAddress("DELETE", pattern, action);
  server_.Delete(pattern, [&metrics = metrics_, &guard = guard_, action,
                        handler = std::move(handler)](
                              const httplib::Request& request, httplib::Response& response,
                              const httplib::ContentReader&) {
    ServeIfAdmitted(metrics, guard, action, request, response,
                    [&] { SendResult(request, response, handler(request)); });
  });
}

void Routes::PostUpload(const std::string& path, Action action, BodyRule rule, Handler handler) {
  guard_.AddAddress("POST", path, action);
  server_.SetBodyRule(path, std::move(rule));
  server_.Post(path, [&metrics = metrics_, &guard = guard_, action,
                        handler = std::move(handler)](
                         const httplib::Request& request, httplib::Response& response,
                         const httplib::ContentReader&) {
    ServeIfAdmitted(metrics, guard, action, request, response,
                    [&] { SendResult(request, response, handler(request)); });
  });
}

void Routes::AddErrorAnswers() {
  server_.set_error_handler([&metrics = metrics_, &guard = guard_](
                                const httplib::Request& request, httplib::Response& response) {
    if (!response.body.empty()) return;  // ours
    const RequestTimer timer(metrics, "none", response);
    if (const auto over = guard.AdmitUnknown(UnixHttpServer::RequestConnection())) {
      response.status = over->http;
      return SendError(response, *over);
    }
    SendUnrouted(guard.addresses(), request, response);
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
