// A bridge as a real process on a private bus: the calling process moves into a fresh network
// namespace with a loopback that carries multicast.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/bridge/frames.h"

namespace myograde {

// Once per process, as root or with user namespaces. An error says what this host lacks; the test
// should skip then.
absl::Status EnterPrivateBus();

class BridgeWorld {
 public:
  // Starts myograde-bridge with `command` and small limits: 50 strays, 5 wrong answers. `options`:
  // additional ones. REQUIRES: EnterPrivateBus() succeeded.
  explicit BridgeWorld(const std::vector<std::string>& command,
                       const std::vector<std::string>& options = {});
  // Hangs up and waits for the bridge to exit.
  ~BridgeWorld();

  // The simulator's end of the socket pair.
  int socket() const { return socket_.get(); }
  Fd TakeSocket() { return std::move(socket_); }
  pid_t pid() const { return pid_; }

  // The bridge's next frame, or DeadlineExceededError.
  absl::StatusOr<BridgeFrame> Receive(absl::Duration timeout = absl::Seconds(10));
  // Sends `payload` as the simulator would.
  void Send(Channel channel, Expect expect, int64_t episode, int64_t step, uint32_t action_size,
            const std::vector<std::byte>& payload);

  // Hangs up; returns the bridge's wait status.
  int HangUp();

 private:
  Fd socket_;
  pid_t pid_ = -1;
};

}  // namespace myograde
