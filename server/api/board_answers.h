// Answers about boards that were made already, until the store changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "server/access/rate_limit.h"
#include "server/api/board_source.h"
#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Their texts. Safe from any thread.
class KeptBoards {
 public:
  // What a text depends on beside the store's rows.
  struct Key {
    std::string config;           // the hash of the track config
    std::string config_in_force;  // the same, of the one in force
    std::string board;
    int view = 0;    // BoardQuery::view
    int64_t at = 0;  // the moment that is asked for; 0: now

    auto operator<=>(const Key&) const = default;
  };
  using Text = std::shared_ptr<const std::string>;

  // The last used ones are kept, as many as these bounds allow and one at least.
  KeptBoards(size_t most, size_t most_bytes) : most_bytes_(most_bytes), most_(most), kept_(most) {}

  // `changes`: the store's count of changes. nullptr: there is none, or it is stale.
  Text Find(const Key& key, int64_t changes);
  // Keeps `text`, unless a newer one is there.
  void Keep(const Key& key, int64_t changes, Text text);

 private:
  struct Kept {
    int64_t changes = -1;
    Text text;
  };

  void Drop(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t most_bytes_;
  const size_t most_;
  Mutex mutex_;
  RecentKeys<Kept, Key> kept_ ABSL_GUARDED_BY(mutex_);
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

// Safe from any thread.
class BoardAnswers {
 public:
  // What is said of a board.
  using Make = std::function<absl::StatusOr<nlohmann::json>(const Transaction& reader,
                                                            const BoardQuery& asked)>;

  // `context` must outlive it.
  BoardAnswers(const ApiContext& context, Make make) : context_(context), make_(std::move(make)) {}

  // The answer about the board that a request asks for; it has the parameters of boards alone.
  ApiResult Get(const Request& request);
  // The text of that answer.
  absl::StatusOr<KeptBoards::Text> TextOf(const Transaction& reader, const BoardQuery& asked);

 private:
  const ApiContext& context_;
  const Make make_;
  // Apart, as boards of the past are asked for without end.
  KeptBoards now_{256, size_t{256} << 20};
  KeptBoards others_{32, size_t{32} << 20};
};

}  // namespace myograde::server
