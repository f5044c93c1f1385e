// Removing files that the organiser's policy no longer keeps: those of submissions
// that can't stand on a board, and logs of their episodes. What has not ended, and
// whatever is done and ranked, stays. The rows of the store stay as well, and
// each removal is one.
#pragma once

#include <string>
#include <thread>
#include <vector>

#include "protocol/base/mutex.h"
#include "server/engine/engine.h"
#include "server/config/server_config.h"
#include "server/store/reader.h"

namespace myograde::server {

// A file or folder that the policy is about.
struct KeptFile {
  std::string name;  // a hash
  std::string path;
  int64_t bytes = 0;
  int64_t last_use = 0;  // ms since 1970-01-01 UTC
  bool needed = false;   // never to be removed
};

struct Choice {
  KeptFile file;
  std::string why;
};

// Which files go: those older than `age`, and then the oldest, until all
// together have at most `bytes`. Oldest first; of equal age by name.
std::vector<Choice> ChooseRemovals(std::vector<KeptFile> files, absl::Duration age, int64_t bytes,
                                   int64_t now_ms);

// Looks after a data folder on a thread of its own, from its making to its end.
class Retention {
 public:
  // All but `limits` must outlive it, and `engine` must be running or about to.
  Retention(RetentionLimits limits, std::string data_dir, Engine& engine, ReaderPool& readers,
            const Clock& clock);
  ~Retention();

 private:
  void Loop();
  // Until the next look is due; true: it is to end.
  bool WaitForStop();
  // One look: what is too old or too much is removed. Trouble is logged.
  void Sweep();
  absl::StatusOr<std::vector<KeptFile>> Artefacts();
  // What came too long ago and was never submitted.
  absl::StatusOr<std::vector<Choice>> Unsubmitted(int64_t now_ms);
  std::vector<KeptFile> Logs();  // `needed` is left out
  absl::StatusOr<std::vector<KeptFile>> WithNeeded(std::vector<KeptFile> logs);
  void Remove(const std::string& kind, const std::vector<Choice>& choices);

  const RetentionLimits limits_;
  const std::string data_dir_;
  Engine& engine_;
  ReaderPool& readers_;
  const Clock& clock_;

  Mutex mutex_;
  Condition wake_;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace myograde::server
