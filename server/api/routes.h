// Binds addresses to handlers. A handler returns an answer or an error as a value; turning it into
// an HTTP response happens here, in one place.
#pragma once

#include <httplib.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "server/api/api_error.h"
#include "server/api/methods.h"
#include "server/api/unix_http_server.h"

namespace myograde::server {

struct ApiAnswer {
  int http = 200;
  nlohmann::json body = nullptr;
  std::shared_ptr<const std::string> text = nullptr;  // JSON in place of `body`, if set
  bool tagged = false;    // has an ETag; whoever has the same already gets 304 and no body
  std::string next = {};  // the address of a list's next page; "": there is none
};
using ApiResult = std::variant<ApiAnswer, ApiError>;

// The entry of README.md's table of errors for a status: by its code (ErrorCodeOf of
// store/quota.h) if it has one, otherwise by its kind.
ApiError ErrorOf(const absl::Status& status);
// The same for an operation that takes a team's name. Only organisers are told which existing team
// a refused name looks like. Only inside handlers.
ApiError TeamErrorOf(const absl::Status& status, const std::string& team);

// The caller as the store's rows name it: "uid 1000". Only inside handlers.
std::string CallerKey();
// An error unless the caller is root or the daemon's own user. Only inside handlers.
std::optional<ApiError> OnlyOrganiser();

// Adds addresses to a server. A pattern is a regular expression that must match the whole path; its
// groups are the request's `matches`.
class Routes {
 public:
  using Handler = std::function<ApiResult(const httplib::Request&)>;
  using JsonHandler = std::function<ApiResult(const httplib::Request&, const nlohmann::json& body)>;
  // Fills in a response that is not JSON, or returns why it could not.
  using FileHandler =
      std::function<std::optional<ApiError>(const httplib::Request&, httplib::Response&)>;

  // `server` must outlive it.
  explicit Routes(UnixHttpServer& server) : server_(server) {}

  // A handler of GET answers HEAD too.
  void Get(const std::string& pattern, Handler handler);
  void GetFile(const std::string& pattern, FileHandler handler);
  // The body is JSON.
  void Post(const std::string& pattern, JsonHandler handler);
  // The body follows `rule`; the handler reads it from UnixHttpServer::RequestBody().
  void PostUpload(const std::string& path, BodyRule rule, Handler handler);
  // Sets the answers to requests that no handler matches, to OPTIONS, and to requests whose handler
  // throws. Call it last.
  void AddErrorAnswers();

 private:
  UnixHttpServer& server_;
  Methods methods_;
};

}  // namespace myograde::server
