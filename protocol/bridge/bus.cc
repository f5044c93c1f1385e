#include "protocol/bridge/bus.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <optional>

#include <absl/strings/str_cat.h>

namespace myograde {
namespace {

struct Place {
  sockaddr_in address = {};
  int ttl = 1;
};

// "udpm://GROUP:PORT", with an optional "?ttl=N".
std::optional<Place> ParseUrl(const std::string& url) {
  char group[16];
  int port = 0, ttl = 1, end = 0, end_of_ttl = 0;
  const int found = std::sscanf(url.c_str(), "udpm://%15[0-9.]:%d%n?ttl=%d%n", group, &port, &end,
                                &ttl, &end_of_ttl);
  if (found < 2 || url.size() != static_cast<size_t>(found == 3 ? end_of_ttl : end)) return {};
  if (port < 1 || port > 65535 || ttl < 0 || ttl > 255) return {};
  Place place;
  place.ttl = ttl;
  place.address.sin_family = AF_INET;
  place.address.sin_port = htons(static_cast<uint16_t>(port));
  if (inet_pton(AF_INET, group, &place.address.sin_addr) != 1 ||
      !IN_MULTICAST(ntohl(place.address.sin_addr.s_addr))) {
    return {};
  }
  return place;
}

template <typename T>
bool SetOption(const Fd& socket, int level, int name, const T& value) {
  return setsockopt(socket.get(), level, name, &value, sizeof(value)) == 0;
}

const sockaddr* Generic(const sockaddr_in& address) {
  return reinterpret_cast<const sockaddr*>(&address);
}

// On failure an invalid descriptor, the failed step, and errno.
Fd OpenSender(const Place& place, const char*& step) {
  Fd sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!sender.valid()) {
    step = "socket";
  } else if (!SetOption(sender, IPPROTO_IP, IP_MULTICAST_TTL, place.ttl)) {
    step = "time to live";
  } else if (connect(sender.get(), Generic(place.address), sizeof(place.address)) != 0) {
    step = "connect";
  } else {
    return sender;
  }
  return Fd();
}

// Makes the kernel drop what `sender` sends, so that nobody wakes up for their own packets. A UDP
// socket's filter sees the packet from its UDP header on, which begins with the sender's port.
bool IgnoreOwn(const Fd& receiver, const Fd& sender) {
  sockaddr_in own = {};
  socklen_t size = sizeof(own);
  if (getsockname(sender.get(), reinterpret_cast<sockaddr*>(&own), &size) != 0) return false;
  sock_filter code[] = {
      BPF_STMT(BPF_LD | BPF_H | BPF_ABS, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ntohs(own.sin_port), 0, 1),
      BPF_STMT(BPF_RET | BPF_K, 0),
      BPF_STMT(BPF_RET | BPF_K, 0xffffffff),
  };
  const sock_fprog program = {static_cast<unsigned short>(std::size(code)), code};
  return SetOption(receiver, SOL_SOCKET, SO_ATTACH_FILTER, program);
}

Fd OpenReceiver(const Place& place, const Fd& sender, std::chrono::milliseconds patience,
                const char*& step) {
  Fd receiver(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const int one = 1;
  const timeval wait = {patience.count() / 1000, patience.count() % 1000 * 1000};
  ip_mreq group = {};
  group.imr_multiaddr = place.address.sin_addr;
  group.imr_interface.s_addr = htonl(INADDR_ANY);
  // Every LCM program shares the port; the kernel requires both options for that.
  if (!receiver.valid()) {
    step = "socket";
  } else if (!SetOption(receiver, SOL_SOCKET, SO_REUSEADDR, one) ||
             !SetOption(receiver, SOL_SOCKET, SO_REUSEPORT, one)) {
    step = "sharing the port";
  } else if (!SetOption(receiver, SOL_SOCKET, SO_RCVTIMEO, wait)) {
    step = "time to wait";
  } else if (!IgnoreOwn(receiver, sender)) {
    step = "packet filter";
  } else if (bind(receiver.get(), Generic(place.address), sizeof(place.address)) != 0) {
    step = "bind";
  } else if (!SetOption(receiver, IPPROTO_IP, IP_ADD_MEMBERSHIP, group)) {
    step = "membership";
  } else {
    return receiver;
  }
  return Fd();
}

}  // namespace

absl::StatusOr<Bus> Bus::Open(const std::string& url, std::chrono::milliseconds patience) {
  const std::optional<Place> place = ParseUrl(url);
  if (!place) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", url, "\" names no LCM bus; it has the form udpm://GROUP:PORT?ttl=N"));
  }
  const char* step = nullptr;
  Fd sender = OpenSender(*place, step);
  Fd receiver = sender.valid() ? OpenReceiver(*place, sender, patience, step) : Fd();
  if (!receiver.valid()) {
    return absl::UnavailableError(absl::StrCat("the LCM bus can't be joined: ", step, ": ",
                                               strerror(errno),
                                               "; is `lo` up with a multicast route?"));
  }
  return Bus(std::move(receiver), std::move(sender));
}

std::span<const std::byte> Bus::Receive() { return ReceiveWith(MSG_DONTWAIT); }

std::span<const std::byte> Bus::Await() { return ReceiveWith(0); }

std::span<const std::byte> Bus::ReceiveWith(int flags) {
  const ssize_t size = recv(receiver_.get(), buffer_.data(), buffer_.size(), flags);
  if (size <= 0) return {};
  return {buffer_.data(), static_cast<size_t>(size)};
}

void Bus::Send(std::string_view channel, std::span<const std::byte> payload) {
  std::array<std::byte, kDatagramHeader + kMaxChannelLength + 1> head;
  const size_t head_size = WriteDatagramHead(sequence_++, channel, head);
  const iovec parts[] = {{head.data(), head_size},
                         {const_cast<std::byte*>(payload.data()), payload.size()}};
  // Errors are ignored: the message is resent if no answer arrives.
  [[maybe_unused]] const ssize_t sent = writev(sender_.get(), parts, 2);
}

}  // namespace myograde
