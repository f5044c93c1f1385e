// A program's two UDP sockets on an LCM bus: one to send, one to receive everything but its own
// packets. For the bridge, which must not parse packets with liblcm, and for the C++ kit, where it
// avoids liblcm's reader thread and pipe in every step. Needs only the C++ library.
//
// A packet that can't be sent counts as lost, since the bridge resends anyway.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/base/fd.h"
#include "protocol/bridge/datagram.h"

namespace myograde {

class Bus {
 public:
  // Joins the bus of an LCM URL, udpm://GROUP:PORT?ttl=N (N defaults to 1); `patience` is how long
  // Await() waits. On failure returns nullopt, and `problem` says in a sentence which part of the
  // URL or which kernel call was rejected.
  static std::optional<Bus> Open(const std::string& url, std::chrono::milliseconds patience,
                                 std::string& problem);

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
