// Binds addresses to handlers. A handler returns an answer or an error as a value; turning it into
// an HTTP response happens here, in one place. No handler runs whose caller may not take the
// address's action.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/guard.h"
#include "server/http/router.h"

namespace myograde::server {

struct ApiAnswer {
  int http = 200;
  nlohmann::json body = nullptr;
  std::shared_ptr<const std::string> text = nullptr;  // JSON in place of `body`, if set
  bool tagged = false;    // has an ETag; whoever has the same already gets 304 and no body
  bool for_all_origins = false;  // pages of other origins may read it, if nobody's token asked
  std::string next = {};  // the address of a list's next page; "": there is none
};
// An error becomes the one that ToApiError says.
using ApiResult = absl::StatusOr<ApiAnswer>;

// The entry of README.md's table of errors for a status: by its code (ErrorCodeOf of
// base/error_code.h) if it has one, otherwise by its kind.
ApiError ToApiError(const absl::Status& status);
// 503 `busy`, to be asked again after so many seconds.
absl::Status Busy(std::string_view message, int64_t retry_after_s);
// The same for an operation that takes a team's name. Only organisers are told which existing team
// a refused name looks like. Only inside handlers.
absl::Status ToTeamError(const absl::Status& status, const std::string& team);

// Adds addresses to a router. A pattern's groups are the request's `matches`. Handlers ask about
// teams with Require (caller.h).
class Routes {
 public:
  using Handler = std::function<ApiResult(const Request&)>;
  using JsonHandler = std::function<ApiResult(const Request&, const nlohmann::json& body)>;
  // Fills in a response that is not JSON, or returns why it could not.
  using FileHandler = std::function<absl::Status(const Request&, Response&)>;

  // All must outlive the server's last request.
  Routes(Router& router, Guard& guard, const ApiContext& context);
  const Router& router() const { return router_; }

  // A handler of GET answers HEAD too.
  void Get(const std::string& pattern, Action action, Handler handler);
  void GetFile(const std::string& pattern, Action action, FileHandler handler);
  // A web page or a file of one, for everybody. It is no address of the API.
  void GetPage(const std::string& path, std::function<void(const Request&, Response&)> handler);
  // The body is JSON.
  void Post(const std::string& pattern, Action action, JsonHandler handler);
  // The body follows `rule`; the handler reads it from the request.
  void PostUpload(const std::string& path, Action action, BodyRule rule, Handler handler);

 private:
  void Add(Address address);

  Router& router_;
  Guard& guard_;
  const ApiContext& context_;
};

}  // namespace myograde::server
