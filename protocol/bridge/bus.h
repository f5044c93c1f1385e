// A program's two UDP sockets on an LCM bus: one to send, one to receive everything but its own
// packets. For the bridge, which must not parse a participant's packets with liblcm; everything
// else uses liblcm.
//
// A packet that can't be sent counts as lost, since the bridge resends anyway.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/bridge/datagram.h"

namespace myograde {

class Bus {
 public:
  // Joins the bus of an LCM URL, udpm://GROUP:PORT?ttl=N (N defaults to 1); `patience` is how long
  // Await() waits. InvalidArgumentError for an invalid URL, UnavailableError with the step that the
  // kernel rejected.
  static absl::StatusOr<Bus> Open(const std::string& url, std::chrono::milliseconds patience);

  // For poll: readable when a datagram from another sender is waiting.
  int fd() const { return receiver_.get(); }

  // The next datagram from another sender, empty if none is waiting. Valid until the next call.
  std::span<const std::byte> Receive();
  // The same, but waits for one as long as given to Open(); may return empty earlier.
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

}  // namespace myograde
