// One program's two UDP sockets on an LCM bus: one that speaks and one that
// hears all but what the first one says. For the bridge, which must not parse a
// participant's packets with liblcm; everybody else takes liblcm.
//
// A packet that can't be sent counts as lost, since the bridge asks again anyway.
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
  // Joins the bus of an LCM URL, udpm://GROUP:PORT?ttl=N (N is 1 without it); `patience` is how
  // long Await() waits. InvalidArgumentError if the URL is of no bus, UnavailableError with the
  // step that the kernel refused.
  static absl::StatusOr<Bus> Open(const std::string& url, std::chrono::milliseconds patience);

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

}  // namespace myograde
