// Removes files that the organiser's retention policy no longer keeps: those of submissions that
// can't stand on a board, and their episode logs. Files of unfinished and of ranked evaluations
// stay. So do the store's rows, and each removal adds one.
#pragma once

#include <string>
#include <thread>
#include <vector>

#include "protocol/base/mutex.h"
#include "server/engine/engine.h"
#include "server/config/server_config.h"
#include "server/store/reader.h"

namespace myograde::server {

// A file or folder under the retention policy.
struct KeptFile {
  std::string name;  // a hash
  std::string path;
  int64_t bytes = 0;
  int64_t last_use = 0;  // ms since 1970-01-01 UTC
  bool needed = false;   // never removed
};

struct Choice {
  KeptFile file;
  std::string why;
};

// Chooses the files to remove: those older than `age`, then the oldest until the rest is at most
// `bytes` in total. Returned oldest first; equal ages by name.
std::vector<Choice> ChooseRemovals(std::vector<KeptFile> files, absl::Duration age, int64_t bytes,
                                   int64_t now_ms);

// Sweeps a data folder on its own thread, from construction to destruction.
class Retention {
 public:
  // `disk_reserve`: bytes of the folder's disk; below it logs of practice are removed, of running
  // ones too. Everything but `limits` must outlive it; `engine` must be running or about to run.
  Retention(RetentionLimits limits, int64_t disk_reserve, std::string data_dir, Engine& engine,
            ReaderPool& readers, const Clock& clock);
  ~Retention();

 private:
  void Loop();
  // Waits until the next sweep is due, and makes room meanwhile. True: it is time to stop.
  bool WaitForStop();
  // One sweep: removes what is too old or too much. Errors are logged.
  void Sweep();
  absl::StatusOr<std::vector<KeptFile>> Artefacts();
  // Removes the oldest logs of practice while the disk lacks its reserve.
  void MakeRoom();
  // Uploads that are too old and were never submitted.
  absl::StatusOr<std::vector<Choice>> Unsubmitted(int64_t now_ms);
  std::vector<KeptFile> Logs();  // leaves `needed` unset
  absl::StatusOr<std::vector<KeptFile>> WithNeeded(std::vector<KeptFile> logs);
  void Remove(const std::string& kind, const std::vector<Choice>& choices);

  const RetentionLimits limits_;
  const int64_t disk_reserve_;
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
