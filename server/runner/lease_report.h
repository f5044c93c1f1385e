// Checks a runner's records against what was ordered: a state machine over records and times,
// without a process, clock or store. Whoever plays a lease feeds it and acts on the result.
//
//   running ──end record──► reported ──the runner exits, or lingers──► done
//      └──────── any violation ────────► faulty: the grader's fault, and why
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
  // How long a runner may take to exit after its end record.
  static constexpr absl::Duration kFarewell = absl::Seconds(3);

  struct Limits {
    absl::Duration deadline = absl::InfiniteDuration();  // time by which the end record must have
                                                         // arrived
    absl::Duration silence = absl::InfiniteDuration();   // longest gap between records
  };

  LeaseReport() = default;
  // All times are of one monotonic clock.
  LeaseReport(const std::vector<EpisodeOrder>& episodes, Limits limits, absl::Duration now);

  // What the records added: each episode once, and only if it was ordered. Nothing counts after a
  // fault.
  struct News {
    std::optional<ProgressRecord> progress;
    std::vector<EpisodeFacts> episodes;
    std::vector<ReplayRecord> replays;
  };
  News Take(const std::vector<LeaseRecord>& records, absl::Duration now);

  // Checks the time: a late or silent runner is faulty, unless its end record has arrived.
  void Tick(absl::Duration now);

  // Records a fault for the caller's own reason; the first reason stays.
  void Fail(const std::string& why);

  // No more records will come: decides between done and faulty. `wait_status` and `last_words` (the
  // runner's standard error) explain a missing end record.
  void Conclude(int wait_status, const std::string& last_words);

  bool faulty() const { return !fault_.empty(); }
  const std::string& fault() const { return fault_; }  // one sentence; "" if there is none
  const std::optional<LeaseEndRecord>& end() const { return end_; }
  int64_t reported() const { return static_cast<int64_t>(reported_.size()); }  // episodes
  // The end record has arrived, and the time to exit is over.
  bool lingers(absl::Duration now) const {
    return !faulty() && end_.has_value() && now - heard_ >= kFarewell;
  }

 private:
  void TakeEpisode(int64_t index, std::optional<uint64_t> seed);

  std::map<int64_t, uint64_t> ordered_;  // seeds by index
  Limits limits_;
  std::set<int64_t> reported_;
  std::optional<LeaseEndRecord> end_;
  absl::Duration heard_;
  std::string fault_;
};

}  // namespace myograde::server
