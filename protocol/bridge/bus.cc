#include "protocol/bridge/bus.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <array>
#include <cerrno>
#include <iterator>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/channels.h"

namespace myograde::bridge {
namespace {

absl::Status Refused(absl::string_view step) {
  return absl::UnavailableError(absl::StrCat("the LCM bus can't be joined: ", step, ": ",
                                             strerror(errno),
                                             "; is `lo` up with a multicast route?"));
}

sockaddr_in BusAddress() {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(kBusPort);
  inet_pton(AF_INET, kBusGroup, &address.sin_addr);
  return address;
}

template <typename T>
bool SetOption(const Fd& socket, int level, int name, const T& value) {
  return setsockopt(socket.get(), level, name, &value, sizeof(value)) == 0;
}

absl::StatusOr<Fd> OpenSender() {
  Fd sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!sender.valid()) return Refused("socket");
  const int none = 0;
  if (!SetOption(sender, IPPROTO_IP, IP_MULTICAST_TTL, none)) return Refused("time to live");
  const sockaddr_in address = BusAddress();
  if (connect(sender.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Refused("connect");
  }
  return sender;
}

// Lets the kernel drop what `sender` sends, so that the bridge does not wake up
// for its own packets. A UDP socket's filter sees the packet from its UDP
// header on, which begins with the sender's port.
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

absl::StatusOr<Fd> OpenReceiver(const Fd& sender, absl::Duration patience) {
  Fd receiver(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!receiver.valid()) return Refused("socket");
  const int one = 1;
  // Every LCM program shares the port; the kernel wants both words for it.
  if (!SetOption(receiver, SOL_SOCKET, SO_REUSEADDR, one) ||
      !SetOption(receiver, SOL_SOCKET, SO_REUSEPORT, one)) {
    return Refused("sharing the port");
  }
  if (!SetOption(receiver, SOL_SOCKET, SO_RCVTIMEO, absl::ToTimeval(patience))) {
    return Refused("time to wait");
  }
  if (!IgnoreOwn(receiver, sender)) return Refused("packet filter");
  const sockaddr_in address = BusAddress();
  if (bind(receiver.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Refused("bind");
  }
  ip_mreq group = {};
  group.imr_multiaddr = address.sin_addr;
  group.imr_interface.s_addr = htonl(INADDR_ANY);
  if (!SetOption(receiver, IPPROTO_IP, IP_ADD_MEMBERSHIP, group)) return Refused("membership");
  return receiver;
}

}  // namespace

absl::StatusOr<Bus> Bus::Open(absl::Duration patience) {
  absl::StatusOr<Fd> sender = OpenSender();
  if (!sender.ok()) return sender.status();
  absl::StatusOr<Fd> receiver = OpenReceiver(*sender, patience);
  if (!receiver.ok()) return receiver.status();
  return Bus(*std::move(receiver), *std::move(sender));
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
  // Nothing to do about an error: the message is sent again if no answer comes.
  [[maybe_unused]] const ssize_t sent = writev(sender_.get(), parts, 2);
}

}  // namespace myograde::bridge
