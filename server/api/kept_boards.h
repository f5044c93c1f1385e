// Boards that were made already, as texts, until the store changes. Safe from any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <tuple>

#include "protocol/base/mutex.h"

namespace myograde::server {

class KeptBoards {
 public:
  // What a text depends on beside the store's rows.
  struct Key {
    std::string config;           // the hash of the track config
    std::string config_in_force;  // the same, of the one in force
    std::string board;
    int view = 0;                 // BoardQuery::view
    int64_t at = 0;               // the moment that is asked for; 0: now

    auto operator<=>(const Key&) const = default;
  };
  using Text = std::shared_ptr<const std::string>;

  // The last used ones are kept, as many as these bounds allow and one at least.
  KeptBoards(size_t most, size_t most_bytes) : most_(most), most_bytes_(most_bytes) {}

  // `changes`: the store's count of changes. nullptr: there is none, or it is stale.
  Text Find(const Key& key, int64_t changes);
  // Keeps `text`, unless a newer one is there.
  void Keep(const Key& key, int64_t changes, Text text);

  size_t size();

 private:
  struct Kept {
    int64_t changes = -1;
    Text text;
    std::list<Key>::iterator used;
  };

  void Drop(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t most_;
  const size_t most_bytes_;
  Mutex mutex_;
  std::map<Key, Kept> kept_ ABSL_GUARDED_BY(mutex_);
  std::list<Key> used_ ABSL_GUARDED_BY(mutex_);  // the last used one first
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace myograde::server
