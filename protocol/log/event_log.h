// LCM's event-log format, as read by `lcm-logplayer` and lcm.EventLog. An event is, with whole
// numbers in big-endian order:
//
//   u32 0xEDA1DA01, u64 number of the event, u64 time in microseconds,
//   u32 bytes of the channel's name, u32 bytes of the message, name, message
//
// Implemented here rather than with liblcm, whose reader trusts the lengths in a file, as logs may
// come from anywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde {

// An event's size besides its channel's name and its message.
inline constexpr size_t kEventHeadBytes = 28;

// Appends one event to `out`.
void AppendEvent(int64_t number, int64_t time_us, std::string_view channel,
                 std::span<const std::byte> message, std::string& out);

struct LogEvent {
  int64_t number = 0;
  int64_t time_us = 0;
  std::string_view channel;
  std::span<const std::byte> message;
  size_t offset = 0;  // of the event's first byte in the log
};

// The size of the event that `begin` starts with, according to its head; nullopt if the head is
// incomplete. DataLossError: not the start of an event.
absl::StatusOr<std::optional<size_t>> EventBytes(std::string_view begin);

// Iterates over a log in memory, which must outlive the reader and its events.
class EventLogReader {
 public:
  explicit EventLogReader(std::string_view log) : log_(log) {}

  // The next event, or nullopt at the end. DataLossError names the byte at which the log becomes
  // invalid.
  absl::StatusOr<std::optional<LogEvent>> Next();

 private:
  std::string_view log_;
  size_t at_ = 0;
};

}  // namespace myograde
