// Reads episode logs, packed with zstd or not. Logs may come from anywhere: at every moment, what
// is read and unpacked is bounded by the size that the log's own header allows.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde {

// Unpacked logs larger than this are rejected, whatever their header says. The longest episode of
// the challenge's tracks takes 40 MB.
inline constexpr int64_t kMaxLogBytes = int64_t{512} << 20;

// Unpacks a log that arrives in pieces, in little memory.
class LogUnpacker {
 public:
  // Receives the unpacked pieces; an error ends the unpacking.
  using Sink = std::function<absl::Status(std::string_view)>;

  explicit LogUnpacker(Sink sink);
  ~LogUnpacker();

  // The next piece, of any size. DataLossError as ReadPackedLog, or the sink's error; don't call
  // again after an error.
  absl::Status Take(std::string_view piece);
  // The log is complete.
  absl::Status End();

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

// Reads `fd` to its end, or until the content can't be a log. DataLossError: damaged, truncated, or
// larger than an episode with its header can produce.
absl::StatusOr<std::string> ReadPackedLog(int fd);

// The same for bytes in memory.
absl::StatusOr<std::string> UnpackLog(std::string_view packed);

}  // namespace myograde
