// Rejudges: a board's submissions judged again under another config.
#pragma once

#include <cstdint>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class RejudgesResource {
 public:
  // `context` must outlive it.
  explicit RejudgesResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Get(const Request& request) const;
  ApiResult Create(const Request& request, const nlohmann::json& body) const;
  ApiResult Apply(const Request& request, const nlohmann::json& body) const;
  ApiResult Drop(const Request& request, const nlohmann::json& body) const;

  // The rejudge as it is now, with `more` keys.
  ApiResult Show(int64_t id, int http, nlohmann::json more) const;
  // The hash of the config in force on its board.
  absl::StatusOr<std::string> ConfigInForce(int64_t id) const;
  // Has the daemon play and show the board's new config once an act is written.
  AfterRejudge PlayFromNowOn() const;

  const ApiContext& context_;
};

}  // namespace myograde::server
