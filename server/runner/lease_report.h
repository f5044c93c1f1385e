// What a lease's runner has told so far, held against what was ordered: a state machine of records
// and moments, without a process, a clock or a store. Whoever plays a lease feeds it and does what
// follows.
//
//   running ──last record──► told ──the runner ends, or lingers──► done
//      └──────── anything that must not be ────────► faulty: the grader's fault, and why
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

class LeaseReport {
 public:
  // For a runner to end once it has told its last record.
  static constexpr absl::Duration kFarewell = absl::Seconds(3);

  struct Limits {
    absl::Duration deadline = absl::InfiniteDuration();  // moment by which the last record is told
    absl::Duration silence = absl::InfiniteDuration();   // between two records
  };

  LeaseReport() = default;
  // Moments are those of one monotonic clock.
  LeaseReport(const std::vector<EpisodeOrder>& episodes, Limits limits, absl::Duration now);

  // What the records brought, each episode once and only if it was ordered. Nothing counts after a
  // fault.
  struct News {
    std::optional<ProgressRecord> progress;
    std::vector<EpisodeFacts> episodes;
    std::vector<ReplayRecord> replays;
  };
  News Take(const std::vector<LeaseRecord>& records, absl::Duration now);

  // Time passed: a runner that is late or silent is faulty, unless it has told its last record.
  void Tick(absl::Duration now);

  // The caller's own reason; the first one stays.
  void Fail(const std::string& why);

  // No more records come. Now the lease is done or faulty. `wait_status` and `last_words` (what the
  // runner wrote to standard error) are of a runner without a last record.
  void Conclude(int wait_status, const std::string& last_words);

  bool faulty() const { return !fault_.empty(); }
  const std::string& fault() const { return fault_; }  // one sentence; "" if there is none
  const std::optional<LeaseEndRecord>& end() const { return end_; }
  int64_t told() const { return static_cast<int64_t>(told_.size()); }  // episodes
  // All is told, and the runner has had its time to end.
  bool lingers(absl::Duration now) const {
    return !faulty() && end_.has_value() && now - heard_ >= kFarewell;
  }

 private:
  void TakeEpisode(int64_t index, std::optional<uint64_t> seed);

  std::map<int64_t, uint64_t> ordered_;  // seeds by index
  Limits limits_;
  std::set<int64_t> told_;
  std::optional<LeaseEndRecord> end_;
  absl::Duration heard_;
  std::string fault_;
};

}  // namespace myograde::server
