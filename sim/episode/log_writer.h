// Writes the logs of a lease's episodes into the pipe to the runner: encoded,
// hashed, packed with zstd, and never larger than their budget.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/tracks/episode_facts.h"
#include "protocol/log/episode_log.h"
#include "protocol/base/sha256.h"

namespace myograde::sim {

class LogWriter {
 public:
  // `fd`: a pipe, non-blocking, not owned. `budget`: bytes that a packed log may
  // have, at least kMinBudget. `period`: s of simulated time of a step.
  LogWriter(int fd, int64_t budget, double period);
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  static constexpr int64_t kMinBudget = 1 << 20;

  // The calls of one log, in this order. Once the pipe fails, or nobody empties
  // it for a minute, everything is dropped and End tells why.
  void Begin(const LogHeader& header);
  void Start(const LogStart& start);
  // A step that does not fit into the budget any more is left out, and so are
  // all after it.
  void Step(std::span<const double> action, const ShortDigest& observation,
            const ShortDigest& state);
  // Completes `end.logged`. On return the whole log is in the pipe.
  absl::StatusOr<EpisodeLogInfo> End(LogEnd end);

 private:
  struct Packer;
  void Flush();
  void Pack(bool last);
  absl::Status Send(std::span<const char> bytes);

  const int fd_;
  const int64_t budget_;
  EpisodeLogEncoder encoder_;
  std::unique_ptr<Packer> packer_;
  Sha256 digest_;
  std::string waiting_;         // encoded, not packed yet
  int64_t waiting_steps_ = 0;
  EpisodeLogInfo info_;
  bool full_ = false;
  bool started_ = false;
  absl::Status status_;
};

}  // namespace myograde::sim
