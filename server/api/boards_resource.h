// Leaderboards, and why they are as they are.
#pragma once

#include <optional>

#include <nlohmann/json.hpp>

#include "server/api/board_answers.h"
#include "server/api/context.h"
#include "server/api/kept_statistics.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class BoardsResource {
 public:
  // Both must outlive it.
  BoardsResource(const ApiContext& context, KeptStatistics& statistics);

  void Install(Routes& routes);

 private:
  ApiResult Get(const Request& request);
  absl::Status Badge(const Request& request, Response& response);
  absl::Status Feed(const Request& request, Response& response);
  ApiResult Explain(const Request& request) const;
  ApiResult Rebuild(const Request& request, const nlohmann::json& body) const;

  const ApiContext& context_;
  BoardAnswers answers_;
};

}  // namespace myograde::server
