// The bridge's two UDP sockets on the LCM bus of its network namespace. A packet
// that can't be sent counts as lost, since the bridge sends again anyway.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/bridge/datagram.h"

namespace myograde::bridge {

class Bus {
 public:
  // Joins the bus; `patience` is how long Await() waits. Errors say which step the kernel
  // refused.
  static absl::StatusOr<Bus> Open(absl::Duration patience);

  // For poll: readable when a datagram of another sender waits.
  int fd() const { return receiver_.get(); }

  // The next datagram of another sender, empty if none waits. Valid until the
  // next call.
  std::span<const std::byte> Receive();
  // The same, but waits for one as long as Open() was told; may be empty sooner.
  std::span<const std::byte> Await();

  // Sends one short message with the next sequence number.
  void Send(std::string_view channel, std::span<const std::byte> payload);

 private:
  std::span<const std::byte> ReceiveWith(int flags);

  Bus(Fd receiver, Fd sender) : receiver_(std::move(receiver)), sender_(std::move(sender)) {}

  Fd receiver_;
  Fd sender_;
  uint32_t sequence_ = 0;
  std::vector<std::byte> buffer_ = std::vector<std::byte>(kMaxDatagram + 1);
};

}  // namespace myograde::bridge
