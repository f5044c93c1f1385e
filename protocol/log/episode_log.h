// The log of an episode: everything that its states follow from, and a digest of
// each of them, as events of LCM's log format. Times are simulated, so equal
// episodes have equal logs. In this order:
//
//   MYOGRADE_LOG_HEADER  log_text_t     what is played: LogHeader
//   MYOGRADE_LOG_START   log_text_t     how: LogStart; missing if no policy got ready
//   MYOGRADE_ACTION      action_t       for each step ...
//   MYOGRADE_LOG_DIGEST  step_digest_t  ... and what became of it
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
#include "protocol/policy/leg_parameters.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/track_config.h"

namespace myograde {

// The first 8 bytes of a SHA-256 digest.
using ShortDigest = std::array<uint8_t, 8>;
ShortDigest Shorten(const Sha256Digest& digest);

struct LogHeader {
  TrackConfig track;    // with this episode's seed alone, so that a log tells no other one
  std::string config;   // hash of the evaluation's whole config
  int64_t episode = 0;  // in the evaluation, from 0
  bool first = true;    // of its lease: nothing carries over from an episode before
  uint64_t seed = 0;
  bool begun = true;    // false: the lease had ended by a fault; nothing was reset or played
};

struct LogStart {
  ActionConvention convention = ActionConvention::kNormalized;
  LegParameterSets sets = {};  // in force in this episode; none present: the defaults
};

struct LogEnd {
  int64_t steps = 0;      // that were played
  int64_t logged = 0;     // steps in the log; fewer if it would have grown too large
  std::string end;        // EpisodeEndName, or the outcome of a fault
  std::string digest;     // EpisodeFacts::digest
};

// Makes a log, a piece at a time. Every call appends events to `out` below,
// which the caller empties as it likes.
class EpisodeLogEncoder {
 public:
  // Times are multiples of `period` (s).
  explicit EpisodeLogEncoder(double period);
  ~EpisodeLogEncoder();
  EpisodeLogEncoder(const EpisodeLogEncoder&) = delete;
  EpisodeLogEncoder& operator=(const EpisodeLogEncoder&) = delete;

  // Begins another log.
  void Header(const LogHeader& header, std::string& out);
  void Start(const LogStart& start, std::string& out);
  void Step(std::span<const double> action, const ShortDigest& observation,
            const ShortDigest& state, std::string& out);
  // `before`: hexadecimal SHA-256 of all that was appended before.
  void End(const LogEnd& end, const std::string& before, std::string& out);
  // As if so many events and steps had been appended.
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
  std::vector<double> actions;  // action_size of them for each step
  std::vector<ShortDigest> observations;
  std::vector<ShortDigest> states;
  LogEnd end;

  int64_t steps() const { return static_cast<int64_t>(states.size()); }
  std::span<const double> action(int64_t step) const {
    const auto size = static_cast<size_t>(action_size);
    return {actions.data() + static_cast<size_t>(step) * size, size};
  }
};

// The most bytes that a log can have, by the header that it begins with; nullopt if
// `begin` does not hold the whole header yet. DataLossError: no log begins so.
absl::StatusOr<std::optional<int64_t>> LogBytesLimit(std::string_view begin);

// Reads a whole log. REQUIRES nothing of `bytes`. DataLossError: cut, altered
// (the checksum does not fit) or no log of an episode; it says which.
absl::StatusOr<EpisodeLog> ParseEpisodeLog(std::string_view bytes);

}  // namespace myograde
