#include "server/api/kept_boards.h"

#include <utility>

namespace myograde::server {

KeptBoards::Text KeptBoards::Find(const Key& key, int64_t changes) {
  const MutexLock lock(mutex_);
  const auto it = kept_.find(key);
  if (changes < 0 || it == kept_.end() || it->second.changes != changes) return nullptr;
  used_.splice(used_.begin(), used_, it->second.used);
  return it->second.text;
}

void KeptBoards::Keep(const Key& key, int64_t changes, Text text) {
  if (changes < 0) return;  // the count can't be read, so nobody could tell whether it is stale
  const MutexLock lock(mutex_);
  if (const auto it = kept_.find(key); it != kept_.end()) {
    if (it->second.changes >= changes) return;
    Drop(key);
  }
  used_.push_front(key);
  bytes_ += text->size();
  kept_.emplace(key, Kept{changes, std::move(text), used_.begin()});
  while (kept_.size() > 1 && (kept_.size() > most_ || bytes_ > most_bytes_)) {
    Drop(Key(used_.back()));
  }
}

void KeptBoards::Drop(const Key& key) {
  const auto it = kept_.find(key);
  bytes_ -= it->second.text->size();
  used_.erase(it->second.used);
  kept_.erase(it);
}

size_t KeptBoards::size() {
  const MutexLock lock(mutex_);
  return kept_.size();
}

}  // namespace myograde::server
