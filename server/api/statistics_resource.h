// Which places of a leaderboard its episodes decide.
#pragma once

#include "server/api/board_answers.h"
#include "server/api/context.h"
#include "server/api/kept_statistics.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class StatisticsResource {
 public:
  // Both must outlive it.
  StatisticsResource(const ApiContext& context, KeptStatistics& statistics);

  void Install(Routes& routes);

 private:
  ApiResult Get(const Request& request);

  BoardAnswers answers_;
};

}  // namespace myograde::server
