// The port for the network: what keeps it shut.
#include "server/http/tcp_listener.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include "server/base/ip_address.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

ListenConfig PlainAt(const std::string& address, int port = 0) {
  ListenConfig config;
  config.address = address;
  config.port = port;
  return config;
}

TEST(TcpListenerTest, TellsItsPortAndWhoComes) {
  absl::StatusOr<std::unique_ptr<TcpListener>> door = TcpListener::Open(PlainAt("127.0.0.1"));
  ASSERT_TRUE(door.ok()) << door.status();
  ASSERT_THAT((*door)->url(), StartsWith("http://127.0.0.1:"));
  int port = 0;
  ASSERT_TRUE(
      absl::SimpleAtoi((*door)->url().substr(std::string("http://127.0.0.1:").size()), &port));
  ASSERT_GT(port, 0);
  const Fd client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  socklen_t size = 0;
  const sockaddr_storage to =
      IpAddress::Parse("127.0.0.1").value().SocketAddress(static_cast<uint16_t>(port), size);
  ASSERT_EQ(connect(client.get(), reinterpret_cast<const sockaddr*>(&to), size), 0);
  const Listener listener = (*door)->listener();
  EXPECT_FALSE(listener.tls_of);
  const Fd accepted(accept4(listener.fd, nullptr, nullptr, SOCK_CLOEXEC));
  ASSERT_TRUE(accepted.valid());
  const std::optional<Peer> peer = listener.peer_of(accepted.get());
  ASSERT_TRUE(peer.has_value());
  EXPECT_EQ(peer->key, "address 127.0.0.1");
  EXPECT_TRUE(peer->network);
  EXPECT_FALSE(peer->organiser);
  EXPECT_FALSE(peer->proxy);

  const absl::Status again = TcpListener::Open(PlainAt("127.0.0.1", port)).status();
  EXPECT_EQ(again.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(again.message()),
              HasSubstr(absl::StrCat("127.0.0.1:", port, ": another program listens there")));
}

TEST(TcpListenerTest, AnAddressOfAnotherHostIsAMistake) {
  const absl::Status status = TcpListener::Open(PlainAt("192.0.2.1")).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("no interface of this host has the address"));
}

TEST(TcpListenerTest, ACertificateIsCheckedFirst) {
  const ListenConfig config = {
      .address = "127.0.0.1", .port = 0, .certificate = "/nowhere/cert", .key = "/nowhere/key"};
  EXPECT_THAT(std::string(CheckCertificate(config).message()), HasSubstr("/nowhere/cert: "));
  EXPECT_EQ(TcpListener::Open(config).status(), CheckCertificate(config));
  EXPECT_TRUE(CheckCertificate(PlainAt("127.0.0.1")).ok()) << "plain HTTP needs none";
}

}  // namespace
}  // namespace myograde::server
