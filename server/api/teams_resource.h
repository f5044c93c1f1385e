// Teams: who belongs to them, their names, merging and banning them.
#pragma once

#include <functional>
#include <string>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class TeamsResource {
 public:
  // `context` must outlive it.
  explicit TeamsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Get(const Request& request) const;
  ApiResult Create(const Request& request, const nlohmann::json& body) const;
  ApiResult Rename(const Request& request, const nlohmann::json& body) const;
  ApiResult SetMember(const Request& request, const nlohmann::json& body) const;
  ApiResult Merge(const Request& request, const nlohmann::json& body) const;
  ApiResult Ban(const Request& request, const nlohmann::json& body) const;

  // Does it, and answers with the team as it is afterwards. `change` returns whether it changed
  // anything.
  ApiResult Change(const std::string& team,
                   std::function<absl::StatusOr<bool>(Writer&)> change, int http = 200) const;
  // What the two teams have used, and what one team of both would have used.
  absl::StatusOr<nlohmann::json> ConsequencesOf(const std::string& team,
                                                const std::string& into) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
