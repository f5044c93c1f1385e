#include "server/api/connection.h"

#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using Next = Connection::Next;

// How much a worker spools to disk before others get a turn.
constexpr size_t kTurnBytes = 4 << 20;

TEST(ConnectionTest, WhatWasReadAtATurnsEndIsNotWaitedFor) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends), 0);
  const Fd client(ends[1]);
  const std::string folder = absl::StrCat(testing::TempDir(), "/connection-", getpid());
  std::filesystem::create_directory(folder);
  SpoolBudget budget(int64_t{64} << 20, int64_t{64} << 20);
  const SpoolOptions spool = {folder, /*disk_reserve=*/0, &budget};
  {
    Connection connection(1, Fd(ends[0]), std::make_shared<PeerLoad>(Peer{"a"}));
    const std::string last(1000, 'z');
    connection.in = absl::StrCat("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: ",
                                 kTurnBytes + last.size(), "\r\n\r\n",
                                 std::string(kTurnBytes, 'x'));
    const auto rule_of = [](const Request&) {
      BodyRule rule;
      rule.most = int64_t{16} << 20;
      rule.upload = true;
      return rule;
    };
    ASSERT_EQ(connection.Feed(rule_of, spool), Next::kSpool);
    // The last bytes arrive during the turn, and no more follow.
    ASSERT_EQ(write(client.get(), last.data(), last.size()), std::ssize(last));
    EXPECT_EQ(connection.Spool(spool), Next::kSpool);
    EXPECT_EQ(connection.Spool(spool), Next::kServe);
    EXPECT_EQ(connection.body.size(), std::ssize(last) + static_cast<int64_t>(kTurnBytes));
  }
  std::filesystem::remove_all(folder);
}

// Whom a request is from, if its connection is a `proxy`'s and its head has the header.
std::string AskerOf(bool proxy, const std::string& header) {
  const Peer peer = {.key = "address 127.0.0.1", .network = true, .proxy = proxy};
  int ends[2];
  EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends), 0);
  const Fd client(ends[1]);
  Connection connection(1, Fd(ends[0]), std::make_shared<PeerLoad>(peer));
  connection.in = absl::StrCat("GET / HTTP/1.1\r\nHost: localhost\r\n", header, "\r\n");
  EXPECT_EQ(connection.Feed([](const Request&) { return BodyRule{}; }, {}), Next::kServe);
  return connection.Asker().key;
}

TEST(ConnectionTest, OnlyAProxySaysWhoAsks) {
  const std::string forwarded = "X-Forwarded-For: 192.0.2.7\r\n";
  EXPECT_EQ(AskerOf(false, forwarded), "address 127.0.0.1");
  EXPECT_EQ(AskerOf(true, forwarded), "address 192.0.2.7");
  EXPECT_EQ(AskerOf(true, ""), "address 127.0.0.1");
  EXPECT_EQ(AskerOf(true, "X-Forwarded-For: 2001:db8::1\r\n"), "address 2001:db8::/64");
  // The last one is what the proxy itself has seen; those before may be made up.
  EXPECT_EQ(AskerOf(true, "x-forwarded-for: 1.1.1.1, 2.2.2.2 ,\t192.0.2.7\r\n"), "address 192.0.2.7");
  EXPECT_EQ(AskerOf(true, "X-Forwarded-For: 1.1.1.1\r\n" + forwarded), "address 192.0.2.7");
  EXPECT_EQ(AskerOf(true, "X-Forwarded-For: unknown\r\n"), "address 127.0.0.1");
  EXPECT_EQ(AskerOf(true, "X-Forwarded-For: 192.0.2.7,\r\n"), "address 127.0.0.1");
}

}  // namespace
}  // namespace myograde::server
