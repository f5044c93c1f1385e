// Which places of a leaderboard its episodes decide.
#pragma once

#include "server/api/context.h"
#include "server/api/kept_boards.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class StatisticsResource {
 public:
  // `context` must outlive it.
  explicit StatisticsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Get(const httplib::Request& request);

  const ApiContext& context_;
  // Apart, as boards of the past are asked for without end.
  KeptBoards now_{256, size_t{256} << 20};
  KeptBoards others_{32, size_t{32} << 20};
};

}  // namespace myograde::server
