// An episode's log: everything that its states depend on, and a digest of each state, as events of
// LCM's log format. Times are simulated, so equal episodes have equal logs. In this order:
//
//   MYOGRADE_LOG_HEADER  log_text_t     what is played: LogHeader
//   MYOGRADE_LOG_START   log_text_t     how: LogStart; missing if no policy got ready
//   MYOGRADE_ACTION      action_t       for each step ...
//   MYOGRADE_LOG_DIGEST  step_digest_t  ... and the resulting state
//   MYOGRADE_LOG_END     log_text_t     LogEnd, with a checksum over the whole log
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/policy/layout.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/track_config.h"

namespace myograde {

// The first 8 bytes of a SHA-256 digest.
using ShortDigest = std::array<uint8_t, 8>;
ShortDigest Shorten(const Sha256Digest& digest);

struct LogHeader {
  TrackConfig track;    // with only this episode's seed, so that a log reveals no other
  std::string config;   // hash of the evaluation's whole config
  int64_t episode = 0;  // in the evaluation, from 0
  bool first = true;    // the first of its lease: no state carries over from an earlier episode
  uint64_t seed = 0;
  bool begun = true;    // false: a fault had ended the lease; nothing was reset or played
};

struct LogStart {
  ActionConvention convention = ActionConvention::kNormalized;
  // Uploaded by the policy for this episode, in the form of its track; what is not there is as usual.
  nlohmann::json parameters = nlohmann::json::object();
};

struct LogEnd {
  int64_t steps = 0;      // steps played
  int64_t logged = 0;     // steps in the log; fewer if it would have grown too large
  std::string end;        // EpisodeEndName, or the outcome of a fault
  std::string digest;     // EpisodeFacts::digest
};

// Writes a log incrementally. Every call appends events to `out`, which the caller may empty at any
// time.
class EpisodeLogEncoder {
 public:
  // Times are multiples of `period` (s).
  explicit EpisodeLogEncoder(double period);
  ~EpisodeLogEncoder();
  EpisodeLogEncoder(const EpisodeLogEncoder&) = delete;
  EpisodeLogEncoder& operator=(const EpisodeLogEncoder&) = delete;

  // Starts a new log.
  void Header(const LogHeader& header, std::string& out);
  void Start(const LogStart& start, std::string& out);
  void Step(std::span<const double> action, const ShortDigest& observation,
            const ShortDigest& state, std::string& out);
  // `before`: hexadecimal SHA-256 of everything that was appended before.
  void End(const LogEnd& end, const std::string& before, std::string& out);
  // Continues as if so many events and steps had been appended.
  void Resume(int64_t number, int64_t step);

 private:
  struct Messages;
  template <typename Message>
  void Append(std::string_view channel, int64_t time_us, const Message& message,
              std::string& out);
  void AppendText(std::string_view channel, const nlohmann::json& json, std::string& out);

  const double period_;
  std::unique_ptr<Messages> messages_;
  std::vector<std::byte> buffer_;
  int64_t number_ = 0;
  int64_t episode_ = 0;
  int64_t step_ = 0;
};

// A log as values.
struct EpisodeLog {
  LogHeader header;
  std::optional<LogStart> start;
  int action_size = 0;
  std::vector<double> actions;  // action_size values per step
  std::vector<ShortDigest> observations;
  std::vector<ShortDigest> states;
  LogEnd end;

  int64_t steps() const { return static_cast<int64_t>(states.size()); }
  std::span<const double> action(int64_t step) const {
    const auto size = static_cast<size_t>(action_size);
    return {actions.data() + static_cast<size_t>(step) * size, size};
  }
};

// The largest size of a log with the header that `begin` starts with, in bytes; nullopt if the
// header is incomplete. DataLossError: not the start of a log.
absl::StatusOr<std::optional<int64_t>> LogBytesLimit(std::string_view begin);

// Reads a whole log. REQUIRES nothing of `bytes`. DataLossError: truncated, altered (wrong
// checksum) or not an episode log; the message says which.
absl::StatusOr<EpisodeLog> ParseEpisodeLog(std::string_view bytes);

}  // namespace myograde
