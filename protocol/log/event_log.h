// LCM's event-log format, as `lcm-logplayer` and lcm.EventLog read it. Every
// event is, with whole numbers in big-endian order:
//
//   u32 0xEDA1DA01, u64 number of the event, u64 time in microseconds,
//   u32 bytes of the channel's name, u32 bytes of the message, name, message
//
// Written here rather than through liblcm, as its reader trusts the lengths in
// a file, and logs may come from anywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde {

// Bytes that an event takes besides its channel's name and its message.
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

// The bytes of the whole event that `begin` begins with, as its head says; nullopt if not
// even that is there. DataLossError: no event begins so.
absl::StatusOr<std::optional<size_t>> EventBytes(std::string_view begin);

// Walks over a log in memory, which must outlive it and its events.
class EventLogReader {
 public:
  explicit EventLogReader(std::string_view log) : log_(log) {}

  // The next event, or nothing at the end. DataLossError names the byte at
  // which the log stops making sense.
  absl::StatusOr<std::optional<LogEvent>> Next();

 private:
  std::string_view log_;
  size_t at_ = 0;
};

}  // namespace myograde
