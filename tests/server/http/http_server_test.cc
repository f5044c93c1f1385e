// Hostile clients of all kinds; others must be answered all the same.
#include <sys/resource.h>

#include "tests/server/http/http_server_world.h"

namespace myograde::server {
namespace {

using ::testing::AnyOf;
using ::testing::StartsWith;

TEST_F(HttpServerTest, ServesRequestsThatFollowOneAnother) {
  Start(Limits());
  Client client(path(), "a");
  for (int i = 0; i < 3; ++i) EXPECT_EQ(client.Ask(), kOk);
  const std::string three = absl::StrCat(kGet, Upload(4), "body", kGet);
  client.Send(three);
  EXPECT_EQ(client.Receive(3 * (sizeof(kOk) - 1)), absl::StrCat(kOk, kOk, kOk)) << "pipelined";
  EXPECT_EQ(body_bytes_, 4);
  client.Send(absl::StrCat(kGet, "GE"));
  client.EndSending();
  EXPECT_THAT(client.Receive(1000), StartsWith(absl::StrCat(kOk, "HTTP/1.1 400 ")));
}

// Whom a request of a proxy's connection, or of another one, is from, if its head has this header.
TEST_F(HttpServerTest, OnlyAProxySaysWhoAsks) {
  Start(Limits());
  const auto asker_of = [this](const std::string& peer, const std::string& header) {
    Client client(path(), peer);
    client.Send(absl::StrCat("GET /who HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n", header, "\r\n"));
    const std::string answer = client.Receive(1000);
    return answer.substr(answer.rfind('\n') + 1);
  };
  const std::string forwarded = "X-Forwarded-For: 192.0.2.7\r\n";
  EXPECT_EQ(asker_of("net", forwarded), "net");
  EXPECT_EQ(asker_of("proxy", forwarded), "address 192.0.2.7");
  EXPECT_EQ(asker_of("proxy", ""), "proxy");
  EXPECT_EQ(asker_of("proxy", "X-Forwarded-For: 2001:db8::1\r\n"), "address 2001:db8::/64");
  // The last one is what the proxy itself has seen; those before may be made up.
  EXPECT_EQ(asker_of("proxy", "x-forwarded-for: 1.1.1.1, 2.2.2.2 ,\t192.0.2.7\r\n"), "address 192.0.2.7");
  EXPECT_EQ(asker_of("proxy", "X-Forwarded-For: 1.1.1.1\r\n" + forwarded), "address 192.0.2.7");
  EXPECT_EQ(asker_of("proxy", "X-Forwarded-For: unknown\r\n"), "proxy");
  EXPECT_EQ(asker_of("proxy", "X-Forwarded-For: 192.0.2.7,\r\n"), "proxy");
}

TEST_F(HttpServerTest, BodiesOfAnySizeAndFramingArriveWhole) {
  Start(Limits());
  int64_t sent = 0;
  for (const int64_t size : {1, 65'536, 65'537, 300'000, 5'000'000}) {
    Client client(path(), "a");
    client.Send(Upload(size) + std::string(static_cast<size_t>(size), 'x'));
    EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk) << size;
    EXPECT_EQ(body_bytes_, sent += size);
    client.Send("POST /upload HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n");
    for (int64_t left = size; left > 0; left -= 50'000) {
      const auto chunk = static_cast<size_t>(std::min<int64_t>(left, 50'000));
      client.Send(absl::StrCat(absl::Hex(chunk), "\r\n", std::string(chunk, 'y'), "\r\n"));
    }
    client.Send("0\r\n\r\n");
    EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk) << size;
    EXPECT_EQ(body_bytes_, sent += size);
  }
}

TEST_F(HttpServerTest, WhoAsksFirstHearsToGoOnOrWhyNot) {
  Start(Limits());
  Client client(path(), "a");
  client.Send("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(client.Receive(25), "HTTP/1.1 100 Continue\r\n\r\n");
  client.Send("body");
  EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk);
  client.Send("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9000000\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_THAT(client.Receive(12), "HTTP/1.1 413");
}

TEST_F(HttpServerTest, OneSendersDiskIsBounded) {
  Start(Limits());
  const auto first = Many(1, "a", Upload(8 << 20));
  const auto second = Many(1, "a", Upload(8 << 20));
  Client third(path(), "a");
  third.Send(Upload(1 << 20));
  EXPECT_THAT(third.Receive(12), "HTTP/1.1 429");
  Client other(path(), "b");
  other.Send(Upload(100'000) + std::string(100'000, 'x'));
  EXPECT_EQ(other.Receive(sizeof(kOk) - 1), kOk);
}

TEST_F(HttpServerTest, SilentBodiesHalfHeadsAndIdleConnectionsHoldUpNobody) {
  Start(Limits());
  for (const std::string& text : {Upload(1000) + "x", Upload(1 << 20) + "x", std::string("GET /v"),
                                  std::string()}) {
    const auto crowd = Many(30, "crowd", text);
    const auto more = Many(30, "root", text);
    OthersAreServedSoon();
    // So are those of the crowd's own user, once its connections without a request give way.
    if (text.empty()) {
      EXPECT_EQ(Client(path(), "crowd").Ask(), kOk);
    }
  }
}

TEST_F(HttpServerTest, WhoDoesNotReadItsAnswersHoldsUpNobody) {
  Start(Limits());
  const auto crowd = Many(10, "crowd", "GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n");
  for (int i = 0; i < 5; ++i) OthersAreServed();
  EXPECT_EQ(crowd[0]->Receive(kLarge).size(), kLarge);
}

TEST_F(HttpServerTest, TheSlowAreHungUpOn) {
  HttpLimits limits = Limits();
  limits.speed_window = absl::Seconds(3);
  limits.min_bytes_per_s = 100;
  Start(limits);
  Client silent(path(), "a");
  silent.Send(Upload(5000) + "x");
  Client large(path(), "a");
  large.Send(Upload(500'000) + std::string(100'000, 'x'));
  Client half(path(), "a");
  half.Send("GET /");
  Client unread(path(), "a");
  unread.Send("GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n");
  Client honest(path(), "a");
  honest.Send(Upload(30'000));
  for (int i = 0; i < 30; ++i) {
    honest.Send(std::string(1000, 'x'));
    absl::SleepFor(absl::Milliseconds(200));  // fifty times the required rate
  }
  EXPECT_EQ(honest.Receive(sizeof(kOk) - 1), kOk);
  EXPECT_THAT(silent.Receive(12), "HTTP/1.1 408");
  EXPECT_THAT(large.Receive(12), "HTTP/1.1 408");
  EXPECT_THAT(half.Receive(12), "HTTP/1.1 408");
  unread.AwaitHangUp();
  EXPECT_LT(unread.Receive(kLarge).size(), kLarge);
}

TEST_F(HttpServerTest, IdleConnectionsEnd) {
  HttpLimits limits = Limits();
  limits.idle = absl::Milliseconds(300);
  Start(limits);
  Client client(path(), "a");
  EXPECT_EQ(client.Ask(), kOk);
  EXPECT_TRUE(client.HungUp(absl::Seconds(60)));
}

TEST_F(HttpServerTest, BodiesAreRefusedBeforeAStop) {
  Start(Limits());
  Client body(path(), "a");
  body.Send(Upload(1000) + "x");
  Client large(path(), "a");
  large.Send(Upload(1'000'000) + std::string(70'000, 'x'));
  EXPECT_EQ(Client(path(), "b").Ask(), kOk);
  server_->BeginStop();
  EXPECT_THAT(body.Receive(12), "HTTP/1.1 503");
  EXPECT_THAT(large.Receive(12), "HTTP/1.1 503");
  EXPECT_EQ(Client(path(), "b").Ask(), kOk);
}

TEST_F(HttpServerTest, WithoutDescriptorsItWaitsAndOrganisersAreServed) {
  Start(Limits());
  OthersAreServed();
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  std::vector<Fd> hoard;
  const rlimit low = {256, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  // This process is server and clients: open the sockets first, then leave no descriptor to accept
  // with.
  std::vector<Fd> waiting;
  for (int i = 0; i < 20; ++i) waiting.emplace_back(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  for (;;) {
    Fd fd(dup(0));
    if (!fd.valid()) break;
    hoard.push_back(std::move(fd));
  }
  const auto answer = [](int fd) {
    pollfd entry = {fd, POLLIN, 0};
    char buffer[64];
    if (poll(&entry, 1, 60'000) <= 0) return std::string("nothing");
    const ssize_t n = recv(fd, buffer, 12, 0);
    return std::string(buffer, static_cast<size_t>(std::max<ssize_t>(n, 0)));
  };
  sockaddr_un to = {};
  to.sun_family = AF_UNIX;
  path().copy(to.sun_path, sizeof(to.sun_path) - 1);
  int refused = 0;
  for (size_t i = 0; i < waiting.size(); ++i) {
    const std::string peer = i + 1 == waiting.size() ? "root" : "stranger";
    const std::string name = absl::StrCat(std::string(1, '\0'), "http-", getpid(), "-w", i, "-", peer);
    sockaddr_un own = {};
    own.sun_family = AF_UNIX;
    name.copy(own.sun_path, sizeof(own.sun_path));
    ASSERT_EQ(bind(waiting[i].get(), reinterpret_cast<const sockaddr*>(&own),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())), 0);
    ASSERT_EQ(connect(waiting[i].get(), reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
    // A client that has been rejected may not send any more.
    const ssize_t n = send(waiting[i].get(), kGet, sizeof(kGet) - 1, MSG_NOSIGNAL);
    ASSERT_TRUE(n > 0 || peer != "root");
    // One after the other: none of them gets the organisers' reserve. Connections that ended,
    // earlier or as refused ones do, may leave some places, the later the busier the host is.
    const std::string told = answer(waiting[i].get());
    if (peer == "root") {
      EXPECT_EQ(told, "HTTP/1.1 200");
    } else {
      EXPECT_THAT(told, AnyOf("HTTP/1.1 503", "HTTP/1.1 200")) << i;
      refused += told == "HTTP/1.1 503" ? 1 : 0;
    }
  }
  EXPECT_GE(refused, 10);
  hoard.clear();
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  EXPECT_EQ(Client(path(), "late").Ask(), kOk);
}

}  // namespace
}  // namespace myograde::server
