// Binds addresses to handlers. A handler returns an answer or an error as a value; turning it into
// an HTTP response happens here, in one place. No handler runs whose caller may not take the
// address's action.
#pragma once

#include <httplib.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include <nlohmann/json.hpp>

#include "server/api/api_error.h"
#include "server/api/caller.h"
#include "server/api/error_of.h"
#include "server/api/guard.h"
#include "server/api/unix_http_server.h"
#include "server/metrics/metrics.h"

namespace myograde::server {

struct ApiAnswer {
  int http = 200;
  nlohmann::json body = nullptr;
  std::shared_ptr<const std::string> text = nullptr;  // JSON in place of `body`, if set
  bool tagged = false;    // has an ETag; whoever has the same already gets 304 and no body
  bool for_all_origins = false;  // pages of other origins may read it, if nobody's token asked
  std::string next = {};  // the address of a list's next page; "": there is none
};
using ApiResult = std::variant<ApiAnswer, ApiError>;

// Adds addresses to a server. A pattern is a regular expression that must match the whole path; its
// groups are the request's `matches`. Handlers ask about teams with Require (caller.h).
class Routes {
 public:
  using Handler = std::function<ApiResult(const httplib::Request&)>;
  using JsonHandler = std::function<ApiResult(const httplib::Request&, const nlohmann::json& body)>;
  // Fills in a response that is not JSON, or returns why it could not.
  using FileHandler =
      std::function<std::optional<ApiError>(const httplib::Request&, httplib::Response&)>;

  // All must outlive the server's last request.
  Routes(UnixHttpServer& server, Guard& guard, Metrics& metrics)
      : server_(server), guard_(guard), metrics_(metrics) {}

  // A handler of GET answers HEAD too.
  void Get(const std::string& pattern, Action action, Handler handler);
  void GetFile(const std::string& pattern, Action action, FileHandler handler);
  // A web page or a file of one, for everybody. It is no address of the API.
  void GetPage(const std::string& path,
               std::function<void(const httplib::Request&, httplib::Response&)> handler);
  // The body is JSON.
  void Post(const std::string& pattern, Action action, JsonHandler handler);
  void Delete(const std::string& pattern, Action action, Handler handler);
  // The body follows `rule`; the handler reads it from UnixHttpServer::RequestBody().
  void PostUpload(const std::string& path, Action action, BodyRule rule, Handler handler);
  // Sets the answers to requests that no handler matches, to OPTIONS, and to requests whose handler
  // throws.
  void AddErrorAnswers();

 private:
  UnixHttpServer& server_;
  Guard& guard_;
  Metrics& metrics_;
};

}  // namespace myograde::server
