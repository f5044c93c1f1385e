// Remembers which archives were unpacked into which artefacts, so that the same bytes sent again
// need not be unpacked again. Thread-safe.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>

#include "protocol/base/mutex.h"

namespace myograde::server {

class KnownArchives {
 public:
  // Keeps the `most` most recently added archives.
  explicit KnownArchives(size_t most) : most_(most) {}

  // The artefact that the archive with this SHA-256 (of the file as it was sent) was unpacked to.
  // Its files may have been removed since.
  std::optional<std::string> Find(const std::string& archive) const {
    const MutexLock lock(mutex_);
    const auto known = artefacts_.find(archive);
    return known == artefacts_.end() ? std::nullopt : std::optional(known->second);
  }

  void Learn(const std::string& archive, const std::string& artefact) {
    const MutexLock lock(mutex_);
    if (!artefacts_.insert_or_assign(archive, artefact).second) return;
    order_.push_back(archive);
    if (order_.size() <= most_) return;
    artefacts_.erase(order_.front());
    order_.pop_front();
  }

 private:
  const size_t most_;
  mutable Mutex mutex_;
  std::map<std::string, std::string> artefacts_ ABSL_GUARDED_BY(mutex_);  // by archive
  std::deque<std::string> order_ ABSL_GUARDED_BY(mutex_);  // archives, oldest first
};

}  // namespace myograde::server
