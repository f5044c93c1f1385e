// Reading the log of an episode, packed with zstd or not. Logs may come from
// anywhere: what is read and unpacked is bounded at every moment by what the log
// says itself that it can be.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde {

// A log larger than this, unpacked, is refused, whatever its header says. The
// longest episode of the challenge's tracks takes 40 MB.
inline constexpr int64_t kMaxLogBytes = int64_t{512} << 20;

// Unpacks a log that comes piece by piece, in little memory.
class LogUnpacker {
 public:
  // Takes what was unpacked, piece by piece; an error ends the unpacking.
  using Sink = std::function<absl::Status(std::string_view)>;

  explicit LogUnpacker(Sink sink);
  ~LogUnpacker();

  // The next piece of any size. DataLossError as ReadPackedLog, or what the sink said; nothing may
  // come after an error.
  absl::Status Take(std::string_view piece);
  // Nothing is to come.
  absl::Status End();

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

// Reads `fd` to its end, or until it can be no log any more. DataLossError: damaged,
// cut, or larger than the episode that its header tells of can have made it.
absl::StatusOr<std::string> ReadPackedLog(int fd);

// Likewise of bytes in memory.
absl::StatusOr<std::string> UnpackLog(std::string_view packed);

}  // namespace myograde
