// Removes files that the organiser's retention policy no longer keeps: those of submissions that
// can't stand on a board, and their episode logs. Files of unfinished and of ranked evaluations
// stay. So do the store's rows, and each removal adds one.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <stop_token>
#include <thread>
#include <vector>

#include "server/config/server_config.h"
#include "server/engine/engine.h"
#include "server/store/store.h"

namespace myograde::server {

// A file or folder under the retention policy.
struct KeptFile {
  std::string name;  // a hash
  std::string path;
  int64_t bytes = 0;
  int64_t last_use = 0;  // ms since 1970-01-01 UTC
  bool needed = false;   // never removed
  std::string why = {};  // it is removed
};

// A sweep removes so many files of a kind for their age at most, or a tenth of them if that is more:
// when the clock is wrong, somebody can notice before much is gone.
inline constexpr size_t kFewestAgedOut = 10;

// Chooses the files to remove: those older than `age`, as many as a sweep may, then the oldest until
// the rest is at most `bytes` in total. Returned oldest first; equal ages by name.
std::vector<KeptFile> ChooseRemovals(std::vector<KeptFile> files, absl::Duration age, int64_t bytes,
                                   int64_t now_ms);

// What ages are counted to. A clock that is ahead of what the daemon trusted last by more than
// kLongestPause may be wrong, so time continues from there, by the monotonic clock. A later jump of the
// system clock changes nothing either. After kDoubt of running somebody would have set a wrong clock.
class TrustedTime {
 public:
  static constexpr absl::Duration kLongestPause = absl::Hours(48);
  static constexpr absl::Duration kDoubt = absl::Hours(24 * 7);

  // `before`: as of Store::trusted_time_ms().
  TrustedTime(std::optional<absl::Time> before, const Clock& clock);
  // Never later than the calendar.
  absl::Time Now() const;

 private:
  const Clock& clock_;
  const absl::Duration began_;
  const absl::Time at_began_;
};

// Sweeps a data folder on its own thread, from construction to destruction: first some minutes after
// the start.
class Retention {
 public:
  // `disk_reserve`: bytes of the folder's disk; below it logs of practice are removed, of running
  // ones too. `before`: as of TrustedTime. Everything but `limits` must outlive it; `engine` must be
  // running or about to run.
  Retention(RetentionLimits limits, int64_t disk_reserve, std::string data_dir, Engine& engine,
            ReaderPool& readers, const Clock& clock, std::optional<absl::Time> before);

 private:
  void Loop();
  // Waits until the next sweep is due, and makes room meanwhile. True: it is time to stop.
  bool WaitForSweep(absl::Duration wait);
  // One sweep: removes what is too old or too much. Errors are logged.
  void Sweep();
  // Changes the store; an error is logged as one of `what`.
  void Write(const char* what, const std::function<void(Transaction&)>& change);
  // Keeps the trusted time for the next start.
  void NoteTime();
  absl::StatusOr<std::vector<KeptFile>> Artefacts();
  // Removes the oldest logs of practice while the disk lacks its reserve.
  void MakeRoom();
  // Uploads that are too old and were never submitted.
  absl::StatusOr<std::vector<KeptFile>> Unsubmitted(int64_t now_ms);
  std::vector<KeptFile> Logs();  // leaves `needed` unset
  absl::StatusOr<std::vector<KeptFile>> WithNeeded(std::vector<KeptFile> logs);
  void Remove(const std::string& kind, const std::vector<KeptFile>& files);

  const RetentionLimits limits_;
  const int64_t disk_reserve_;
  const std::string data_dir_;
  Engine& engine_;
  ReaderPool& readers_;
  const Clock& clock_;
  const TrustedTime time_;

  std::stop_token stop_;  // only of the thread
  std::jthread thread_;
};

}  // namespace myograde::server
