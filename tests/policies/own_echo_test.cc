#include "policies/cpp/own_echo.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <string>

#include <gtest/gtest.h>

#include "protocol/base/fd.h"

namespace myograde {
namespace {

constexpr char kGroup[] = "239.255.76.67";

sockaddr_in Address(const char* host, uint16_t port) {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  inet_pton(AF_INET, host, &address.sin_addr);
  return address;
}

// What LCM opens: one socket that hears the group and one that speaks to it.
Fd Reader(uint16_t& port) {
  Fd reader(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const int one = 1;
  EXPECT_EQ(setsockopt(reader.get(), SOL_SOCKET, SO_REUSEADDR, &one, sizeof(one)), 0);
  sockaddr_in address = Address("0.0.0.0", 0);
  EXPECT_EQ(bind(reader.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  socklen_t size = sizeof(address);
  EXPECT_EQ(getsockname(reader.get(), reinterpret_cast<sockaddr*>(&address), &size), 0);
  port = ntohs(address.sin_port);
  ip_mreq membership = {Address(kGroup, 0).sin_addr, Address("127.0.0.1", 0).sin_addr};
  EXPECT_EQ(setsockopt(reader.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership,
                       sizeof(membership)), 0);
  return reader;
}

Fd Sender() {
  Fd sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const in_addr loopback = Address("127.0.0.1", 0).sin_addr;
  EXPECT_EQ(setsockopt(sender.get(), IPPROTO_IP, IP_MULTICAST_IF, &loopback, sizeof(loopback)), 0);
  return sender;
}

void Say(const Fd& sender, uint16_t port, const std::string& text) {
  const sockaddr_in group = Address(kGroup, port);
  ASSERT_EQ(sendto(sender.get(), text.data(), text.size(), 0,
                   reinterpret_cast<const sockaddr*>(&group), sizeof(group)),
            static_cast<ssize_t>(text.size()));
}

std::string Hear(const Fd& reader) {
  pollfd entry = {reader.get(), POLLIN, 0};
  if (poll(&entry, 1, 5000) != 1) return "";
  char text[64];
  const ssize_t size = recv(reader.get(), text, sizeof(text), 0);
  return size < 0 ? "" : std::string(text, static_cast<size_t>(size));
}

TEST(OwnEchoTest, DropsWhatTheBusSaysAndNothingElse) {
  const Fd other = Sender();
  const OwnEcho echo;
  uint16_t port = 0;
  const Fd reader = Reader(port);
  const Fd own = Sender();
  Say(own, port, "own, before");
  EXPECT_EQ(Hear(reader), "own, before");
  ASSERT_TRUE(echo.Silence());
  Say(own, port, "own, after");
  Say(other, port, "other");
  EXPECT_EQ(Hear(reader), "other");
}

TEST(OwnEchoTest, TouchesNoSocketsThatItDoesNotUnderstand) {
  uint16_t port = 0;
  const Fd before = Reader(port);
  const Fd sender_before = Sender();
  const OwnEcho echo;
  EXPECT_FALSE(echo.Silence()) << "sockets of others";
  const Fd reader = Reader(port);
  EXPECT_FALSE(echo.Silence()) << "no sender";
  const Fd silent = Sender();
  EXPECT_FALSE(echo.Silence()) << "a sender that has said nothing has no port";
  Say(silent, port, "hello");
  const Fd second = Sender();
  EXPECT_FALSE(echo.Silence()) << "two senders";
  EXPECT_EQ(Hear(reader), "hello");
}

}  // namespace
}  // namespace myograde
