// Which places of a leaderboard its episodes decide.
#pragma once

#include "server/api/board_answers.h"
#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class StatisticsResource {
 public:
  // `context` must outlive it.
  explicit StatisticsResource(const ApiContext& context);

  void Install(Routes& routes);

 private:
  ApiResult Get(const httplib::Request& request);

  BoardAnswers answers_;
};

}  // namespace myograde::server
