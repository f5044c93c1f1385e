// Which archives were unpacked before, and into what: the same bytes sent again need
// not be unpacked again. Safe from any thread.
#pragma once

#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace myograde::server {

class KnownArchives {
 public:
  // Keeps the `most` archives that were learnt last.
  explicit KnownArchives(size_t most) : most_(most) {}

  // The artefact that the archive with this SHA-256 (of the file as it was sent) is
  // unpacked to. Its files may be gone by now.
  std::optional<std::string> Find(const std::string& archive) const;
  void Learn(const std::string& archive, const std::string& artefact);

 private:
  const size_t most_;
  mutable std::mutex mutex_;
  std::map<std::string, std::string> artefacts_;  // by archive; mutex_
  std::deque<std::string> order_;                 // archives, the oldest first; mutex_
};

}  // namespace myograde::server
