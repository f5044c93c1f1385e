// Which places of a leaderboard its episodes decide.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <tuple>

#include "protocol/base/mutex.h"
#include "server/api/context.h"
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

  struct KeptText {
    int64_t changes = -1;  // the store's count of changes when it was made
    std::shared_ptr<const std::string> text;
  };
  // Hash of the track config, name of the board, and which view of it.
  using Key = std::tuple<std::string, std::string, int>;

  // nullptr: there is none, or it is stale.
  std::shared_ptr<const std::string> Kept(const Key& key, int64_t changes);
  void Keep(const Key& key, KeptText text);

  const ApiContext& context_;
  Mutex mutex_;
  std::map<Key, KeptText> kept_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
