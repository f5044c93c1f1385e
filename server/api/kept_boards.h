// Texts about boards that were made already, until the store changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "protocol/base/mutex.h"
#include "server/access/rate_limit.h"

namespace myograde::server {

// Safe from any thread.
class KeptBoards {
 public:
  using Text = std::shared_ptr<const std::string>;

  // The last used ones are kept, as many as these bounds allow and one at least.
  KeptBoards(size_t most, size_t most_bytes) : most_bytes_(most_bytes), most_(most), kept_(most) {}

  // `key`: all that a text depends on beside the store's rows. `changes`: the store's count of
  // changes. nullptr: there is none, or it is stale.
  Text Find(const std::string& key, int64_t changes) {
    const MutexLock lock(mutex_);
    const Kept* kept = kept_.Find(key);
    return kept == nullptr || changes < 0 || kept->changes != changes ? nullptr : kept->text;
  }

  // Keeps `text`, unless a newer one is there.
  void Keep(const std::string& key, int64_t changes, Text text) {
    if (changes < 0) return;  // the count can't be read, so nobody could tell whether it is stale
    const MutexLock lock(mutex_);
    if (const Kept* kept = kept_.Find(key); kept != nullptr) {
      if (kept->changes >= changes) return;
      Drop(key);
    }
    bytes_ += text->size();
    while (kept_.size() > 0 && (kept_.size() >= most_ || bytes_ > most_bytes_)) {
      Drop(std::string(kept_.oldest()));
    }
    kept_.FindOr(key, {changes, std::move(text)});
  }

 private:
  struct Kept {
    int64_t changes = -1;
    Text text;
  };

  void Drop(const std::string& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    bytes_ -= kept_.Find(key)->text->size();
    kept_.Forget(key);
  }

  const size_t most_bytes_;
  const size_t most_;
  Mutex mutex_;
  RecentKeys<Kept> kept_ ABSL_GUARDED_BY(mutex_);
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace myograde::server
