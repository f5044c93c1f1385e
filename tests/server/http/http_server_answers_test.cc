// Large answers, and rejections that must reach the client.
#include <fcntl.h>
#include <sys/resource.h>

#include "tests/server/http/http_server_world.h"

namespace myograde::server {
namespace {

using ::testing::StartsWith;

TEST_F(HttpServerTest, ARefusedBodyIsReadSoThatItsSenderHearsWhy) {
  Start(Limits());
  for (const char* head : {"POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 20000000\r\n\r\n",
                           "POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5000000\r\n"
                           "Content-Type: multipart/form-data; boundary=x\r\n\r\n"}) {
    Client client(path(), "a");
    client.Send(head);
    client.Send(std::string(5'000'000, 'x'));  // would fail half-way if nobody read it
    EXPECT_THAT(client.Receive(10), "HTTP/1.1 4");
  }
  EXPECT_EQ(body_bytes_, 0);
}

// The head and much of the body arrive in one piece, so that they are there when the request is
// rejected.
TEST_F(HttpServerTest, WhatCameBeforeARefusalIsCountedOnce) {
  constexpr int64_t kBefore = 20'000;
  Start(Limits());
  for (const int64_t after : {kBefore, int64_t{1}, int64_t{300'000}}) {
    Client client(path(), "a");
    client.Send(absl::StrCat("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Type: text/plain\r\n",
                             "Content-Length: ", kBefore + after, "\r\n\r\n",
                             std::string(kBefore, 'x')));
    EXPECT_THAT(client.Receive(1 << 20), StartsWith("HTTP/1.1 415")) << after;
    EXPECT_FALSE(client.Closed(absl::Milliseconds(300))) << "the rest is still to come: " << after;
    client.Send(std::string(static_cast<size_t>(after), 'y'));
    EXPECT_TRUE(client.Closed(absl::Seconds(60))) << "all of it has come: " << after;
  }
}

TEST_F(HttpServerTest, WhoBringsTooManyBodiesHearsSoAfterTheRestOfItToo) {
  Start(Limits());
  const auto crowd = Many(Limits().peer_clients / 2, "a", Upload(1000) + "x");
  AwaitAllSeen();
  Client client(path(), "a");
  client.Send(Upload(1000) + "x");
  EXPECT_THAT(client.Receive(1 << 20), StartsWith("HTTP/1.1 429"));
  EXPECT_FALSE(client.Closed(absl::Milliseconds(300)));
  client.Send(std::string(999, 'x'));
  EXPECT_TRUE(client.Closed(absl::Seconds(60)));
}

TEST_F(HttpServerTest, AFileOfAnySizeTakesLittleMemory) {
  {
    const Fd made(::open(file().c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    ASSERT_EQ(::ftruncate(made.get(), kHuge), 0);
    ASSERT_EQ(::pwrite(made.get(), "end", 3, kHuge - 3), 3);
  }
  Start(Limits());
  // Clients that do not read it hold up nobody.
  const auto crowd = Many(5, "crowd", "GET /file HTTP/1.1\r\nHost: localhost\r\n\r\n");
  OthersAreServed();
  rusage before = {};
  ASSERT_EQ(getrusage(RUSAGE_SELF, &before), 0);
  Client client(path(), "a");
  client.Send(absl::StrCat("GET /file HTTP/1.1\r\nHost: localhost\r\n\r\n", kGet));
  EXPECT_THAT(client.Receive(15), "HTTP/1.1 200 OK");
  while (client.Receive(1) != "\r" || client.Receive(3) != "\n\r\n") {
  }
  std::string piece(256 << 10, '\0');
  for (int64_t left = kHuge - 3; left > 0;) {
    const auto most = static_cast<size_t>(std::min(std::ssize(piece), left));
    const ssize_t n = recv(client.fd(), piece.data(), most, 0);
    ASSERT_GT(n, 0) << left;
    left -= n;
  }
  EXPECT_EQ(client.Receive(3), "end");
  EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk) << "the next request is answered after it";
  rusage after = {};
  ASSERT_EQ(getrusage(RUSAGE_SELF, &after), 0);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 32 << 10) << "KiB";
}

TEST_F(HttpServerTest, AFileThatIsCutEndsTheConnection) {
  {
    const Fd made(::open(file().c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    ASSERT_EQ(::ftruncate(made.get(), 1000), 0);
  }
  Start(Limits());
  Client client(path(), "a");
  client.Send("GET /file HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_LT(client.Receive(1 << 20).size(), 1100u);
  EXPECT_TRUE(client.Closed(absl::Seconds(60)));
}

}  // namespace
}  // namespace myograde::server
