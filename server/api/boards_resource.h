// Leaderboards, and why they are as they are.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <tuple>

#include <nlohmann/json.hpp>

#include "protocol/base/mutex.h"
#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class BoardsResource {
 public:
  // `context` must outlive it.
  explicit BoardsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Get(const httplib::Request& request);
  ApiResult Explain(const httplib::Request& request) const;
  ApiResult Rebuild(const httplib::Request& request, const nlohmann::json& body) const;

  // A board's text, and the store's count of changes when it was made, which shows whether it is
  // stale.
  struct KeptBoard {
    int64_t changes = -1;
    std::shared_ptr<const std::string> text;
  };
  // Hash of the track config, name of the board, and which view of it.
  using Key = std::tuple<std::string, std::string, int>;

  // nullptr: there is none, or it is stale.
  std::shared_ptr<const std::string> Kept(const Key& key, int64_t changes);
  void Keep(const Key& key, KeptBoard board);

  const ApiContext& context_;
  Mutex mutex_;
  std::map<Key, KeptBoard> kept_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
