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
  std::optional<std::string> Find(const std::string& archive) const;
  void Learn(const std::string& archive, const std::string& artefact);

 private:
  const size_t most_;
  mutable Mutex mutex_;
  std::map<std::string, std::string> artefacts_ ABSL_GUARDED_BY(mutex_);  // by archive
  std::deque<std::string> order_ ABSL_GUARDED_BY(mutex_);  // archives, oldest first
};

}  // namespace myograde::server
