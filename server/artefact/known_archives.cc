#include "server/artefact/known_archives.h"

namespace myograde::server {

std::optional<std::string> KnownArchives::Find(const std::string& archive) const {
  const MutexLock lock(mutex_);
  const auto it = artefacts_.find(archive);
  if (it == artefacts_.end()) return std::nullopt;
  return it->second;
}

void KnownArchives::Learn(const std::string& archive, const std::string& artefact) {
  const MutexLock lock(mutex_);
  if (!artefacts_.insert_or_assign(archive, artefact).second) return;
  order_.push_back(archive);
  if (order_.size() <= most_) return;
  artefacts_.erase(order_.front());
  order_.pop_front();
}

}  // namespace myograde::server
