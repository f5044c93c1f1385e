// The body of a request while it arrives and while a handler reads it: in memory if it is small, else
// in a file of the spool, whose space is shared out between senders.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"
#include "server/config/server_config.h"
#include "server/http/request.h"
#include "server/http/peer.h"

namespace myograde::server {

// Bodies up to here stay in memory.
inline constexpr int64_t kMemoryBody = 64 << 10;

// What an address takes for a body.
struct BodyRule {
  int64_t most = 0;                // bytes
  bool upload = false;             // has the time of uploads, and workers of their own
  std::vector<std::string> types;  // of content; the first is the one to tell
};

// The folder for large bodies: how much of its disk they may take, in all and of one peer. For any
// thread. Errors are what the sender is told.
class Spool {
 public:
  Spool(std::string folder, const HttpLimits& limits)
      : folder_(std::move(folder)),
        disk_reserve_(limits.disk_reserve),
        total_(limits.spool_bytes),
        of_a_peer_(limits.peer_spool_bytes) {}

  std::optional<ApiError> Reserve(PeerLoad& peer, int64_t bytes);
  void Release(PeerLoad& peer, int64_t bytes);
  // Whether the disk has room for `bytes` more.
  std::optional<ApiError> CheckDisk(int64_t bytes) const;
  std::string NewPath();

 private:
  const std::string folder_;
  const int64_t disk_reserve_;
  const int64_t total_;
  const int64_t of_a_peer_;
  std::atomic<int64_t> names_ = 0;
  Mutex mutex_;
  int64_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
};

// For one thread at a time.
class Body {
 public:
  // Both must outlive it.
  Body(Spool& spool, PeerLoad& peer) : spool_(spool), peer_(peer) {}
  ~Body() { Drop(); }
  Body(const Body&) = delete;
  Body& operator=(const Body&) = delete;

  int64_t size() const { return size_; }
  // All of it; not for bodies of any length.
  absl::StatusOr<std::string> Text() const;
  // At most `size` bytes from `offset` on; 0 at its end, negative for errors.
  ssize_t ReadAt(char* to, size_t size, int64_t offset) const;
  // Puts it into a new file at `path`, on the spool's file system. It is read no more.
  absl::Status MoveTo(const std::string& path);

  bool spooled() const { return !path_.empty(); }
  // Keeps `bytes` of the spool for it.
  std::optional<ApiError> Reserve(int64_t bytes);
  void Append(std::string_view bytes) { memory_.append(bytes), size_ += std::ssize(bytes); }
  // The same on the disk, where what is in memory goes first. The error is what the sender is told.
  std::optional<ApiError> Write(std::string_view bytes);
  // Frees memory and disk.
  void Drop();

 private:
  std::optional<ApiError> OpenFile();

  Spool& spool_;
  PeerLoad& peer_;
  std::string memory_;
  std::string path_;
  Fd file_;
  int64_t size_ = 0;
  int64_t reserved_ = 0;
};

}  // namespace myograde::server
