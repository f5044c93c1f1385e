#include "protocol/log/event_log.h"

#include <absl/strings/str_cat.h>

namespace myograde {
namespace {

constexpr uint32_t kSync = 0xEDA1DA01;

void PutNumber(uint64_t value, int bytes, std::string& out) {
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) {
    out.push_back(static_cast<char>(value >> shift & 0xff));
  }
}

uint64_t TakeNumber(std::string_view log, size_t& at, int bytes) {
  uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | static_cast<unsigned char>(log[at++]);
  return value;
}

}  // namespace

void AppendEvent(int64_t number, int64_t time_us, std::string_view channel,
                 std::span<const std::byte> message, std::string& out) {
  PutNumber(kSync, 4, out);
  PutNumber(static_cast<uint64_t>(number), 8, out);
  PutNumber(static_cast<uint64_t>(time_us), 8, out);
  PutNumber(channel.size(), 4, out);
  PutNumber(message.size(), 4, out);
  out.append(channel);
  out.append(reinterpret_cast<const char*>(message.data()), message.size());
}

absl::StatusOr<std::optional<size_t>> EventBytes(std::string_view begin) {
  if (begin.size() < kEventHeadBytes) return std::nullopt;
  size_t at = 0;
  if (TakeNumber(begin, at, 4) != kSync) {
    return absl::DataLossError("no event of a log begins at its byte 0; the file is not a log");
  }
  at += 16;  // number and time
  const uint64_t name = TakeNumber(begin, at, 4);
  const uint64_t size = TakeNumber(begin, at, 4);
  return kEventHeadBytes + name + size;
}

absl::StatusOr<std::optional<LogEvent>> EventLogReader::Next() {
  if (at_ == log_.size()) return std::nullopt;
  LogEvent event;
  event.offset = at_;
  const absl::Status bad = absl::DataLossError(
      absl::StrCat("no event of a log begins at its byte ", at_, "; the file is cut or altered"));
  if (log_.size() - at_ < kEventHeadBytes) return bad;
  size_t at = at_;
  if (TakeNumber(log_, at, 4) != kSync) return bad;
  event.number = static_cast<int64_t>(TakeNumber(log_, at, 8));
  event.time_us = static_cast<int64_t>(TakeNumber(log_, at, 8));
  const uint64_t name = TakeNumber(log_, at, 4);
  const uint64_t size = TakeNumber(log_, at, 4);
  if (name > log_.size() - at || size > log_.size() - at - name) return bad;
  event.channel = log_.substr(at, name);
  const std::string_view message = log_.substr(at + name, size);
  event.message = std::as_bytes(std::span(message.data(), message.size()));
  at_ = at + name + size;
  return event;
}

}  // namespace myograde
