// The server over TLS: hostile clients of all kinds, and others who must be answered all the same.
#include <signal.h>

#include <random>

#include "server/http/tcp_listener.h"
#include "tests/server/http/certificate.h"
#include "tests/server/http/http_server_world.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class HttpServerTlsTest : public HttpServerTest {
 protected:
  void SetUp() override {
    HttpServerTest::SetUp();
    signal(SIGPIPE, SIG_IGN);
    const std::string certificate = folder_ + "/cert";
    const std::string key = folder_ + "/key";
    MakeCertificate(certificate, key);
    context_ = TlsContext::Load(certificate, key).value();
    std::filesystem::remove(certificate);
    std::filesystem::remove(key);
    tls_of_ = [this] { return context_; };
  }

  static HttpLimits NetworkLimits() {
    HttpLimits limits = Limits();
    limits.address_clients = 4;
    return limits;
  }

  // The first request of a new connection of `peer`, answered; "" if there is no connection.
  std::string AskOnce(const std::string& peer) {
    Client client(path(), peer);
    TlsEnd end(client.fd());
    if (!end.Handshake() || !end.Send(kGet)) return "";
    return end.Receive(sizeof(kOk) - 1);
  }
  void OthersAreServedByTls() {
    EXPECT_EQ(AskOnce("net-honest"), kOk);
    EXPECT_EQ(AskOnce("honest"), kOk);
    EXPECT_EQ(AskOnce("root"), kOk);
  }
  // What a client says first, as it goes over the wire.
  static std::string ClientHello() {
    int ends[2];
    EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    const Fd ours(ends[0]);
    const Fd theirs(ends[1]);
    std::thread client([&] {
      TlsEnd end(theirs.get());
      end.Handshake();
    });
    std::string hello(4096, '\0');
    hello.resize(
        static_cast<size_t>(std::max<ssize_t>(read(ours.get(), hello.data(), hello.size()), 0)));
    shutdown(ours.get(), SHUT_RDWR);
    client.join();
    return hello;
  }

  std::shared_ptr<TlsContext> context_;
};

TEST_F(HttpServerTlsTest, ServesRequestsOfBothVersions) {
  Start(Limits());
  for (const int version : {TLS1_2_VERSION, TLS1_3_VERSION}) {
    Client client(path(), "net-a");
    TlsEnd end(client.fd(), version);
    ASSERT_TRUE(end.Handshake());
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE(end.Send(kGet));
      EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk);
    }
    EXPECT_TRUE(end.Send(absl::StrCat(kGet, Upload(4), "body", kGet)));
    EXPECT_EQ(end.Receive(3 * (sizeof(kOk) - 1)), absl::StrCat(kOk, kOk, kOk)) << "pipelined";
    int64_t before = body_bytes_;
    for (const int64_t size : {1, 16'384, 65'537, 300'000, 5'000'000}) {
      EXPECT_TRUE(end.Send(Upload(size) + std::string(static_cast<size_t>(size), 'x')));
      EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk) << size;
      EXPECT_EQ(body_bytes_, before += size);
    }
  }
}

TEST_F(HttpServerTlsTest, AnAnswerThatIsTheLastEndsWithAGoodbye) {
  Start(Limits());
  for (const int version : {TLS1_2_VERSION, TLS1_3_VERSION}) {
    Client client(path(), "net-a");
    TlsEnd end(client.fd(), version);
    ASSERT_TRUE(end.Handshake());
    EXPECT_TRUE(end.Send("GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"));
    EXPECT_THAT(end.Receive(1000), StartsWith("HTTP/1.1 200 "));
    EXPECT_EQ(SSL_get_shutdown(end.ssl()) & SSL_RECEIVED_SHUTDOWN, SSL_RECEIVED_SHUTDOWN);
    // Whoever does not answer it is not waited for.
    EXPECT_TRUE(client.Closed(absl::Seconds(10)));
  }
}

TEST_F(HttpServerTlsTest, AHalfRequestIsAnsweredAfterAGoodbyeAndWithoutOne) {
  Start(Limits());
  for (const bool goodbye : {true, false}) {
    Client client(path(), "net-a");
    TlsEnd end(client.fd());
    ASSERT_TRUE(end.Handshake());
    ASSERT_TRUE(end.Send("GET /"));
    if (goodbye) SSL_shutdown(end.ssl());
    client.EndSending();
    EXPECT_THAT(end.Receive(1000), StartsWith("HTTP/1.1 400 "));
  }
}

TEST_F(HttpServerTlsTest, OldVersionsAreRefused) {
  Start(Limits());
  for (const int version : {TLS1_VERSION, TLS1_1_VERSION}) {
    Client client(path(), "net-a");
    EXPECT_FALSE(TlsEnd(client.fd(), version).Handshake());
  }
  OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, SilentAndHalfHandshakesAreCut) {
  HttpLimits limits = NetworkLimits();
  limits.request = absl::Seconds(2);
  Start(limits);
  const std::string hello = ClientHello();
  ASSERT_GT(hello.size(), 100u);
  Client silent(path(), "net-a");
  Client half(path(), "net-b");
  half.Send(hello.substr(0, hello.size() / 2));
  Client stuck(path(), "net-c");  // gets the server's part, and says nothing more
  stuck.Send(hello);
  OthersAreServedByTls();
  for (Client* client : {&silent, &half, &stuck}) client->AwaitHangUp();
  // One byte at a time does not make it longer.
  Client slow(path(), "net-a");
  for (size_t i = 0; i < hello.size() && !slow.Closed(absl::Milliseconds(300)); ++i) {
    slow.Send(hello.substr(i, 1));
    ASSERT_LT(i, 90u) << "27 seconds";
  }
  OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, PlainHttpIsTold) {
  Start(Limits());
  for (const char* request : {kGet, "POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nx"}) {
    Client client(path(), "net-a");
    client.Send(request);
    const std::string answer = client.Receive(10'000);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 400 "));
    EXPECT_THAT(answer, HasSubstr("write https://"));
  }
  OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, RenegotiationIsRefused) {
  Start(Limits());
  Client client(path(), "net-a");
  TlsEnd end(client.fd(), TLS1_2_VERSION);
  ASSERT_TRUE(end.Handshake());
  ASSERT_TRUE(end.Send(kGet));
  EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk);
  ERR_clear_error();
  ASSERT_EQ(SSL_renegotiate(end.ssl()), 1);
  EXPECT_NE(SSL_do_handshake(end.ssl()), 1);
  EXPECT_EQ(ERR_GET_REASON(ERR_peek_last_error()), SSL_R_NO_RENEGOTIATION);
  OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, KeyUpdatesAreAnsweredInTurn) {
  Start(Limits());
  Client client(path(), "net-a");
  TlsEnd end(client.fd(), TLS1_3_VERSION);
  ASSERT_TRUE(end.Handshake());
  for (int i = 0; i < 50; ++i) {
    ASSERT_EQ(SSL_key_update(end.ssl(), SSL_KEY_UPDATE_REQUESTED), 1);
    ASSERT_TRUE(end.Send(kGet));
    EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk);
  }
}

TEST_F(HttpServerTlsTest, SlowReadersGetTheirAnswersAndHoldUpNobody) {
  Start(NetworkLimits());
  Client client(path(), "net-a");
  TlsEnd end(client.fd());
  ASSERT_TRUE(end.Handshake());
  ASSERT_TRUE(end.Send("GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n"));
  OthersAreServedByTls();
  size_t received = 0;
  const std::string head = absl::StrCat("HTTP/1.1 200 OK\r\nContent-Length: ", kLarge, "\r\n\r\n");
  while (received < head.size() + kLarge) {
    const size_t piece =
        end.Receive(std::min<size_t>(100'000, head.size() + kLarge - received)).size();
    ASSERT_GT(piece, 0u);
    received += piece;
    absl::SleepFor(absl::Milliseconds(1));
  }
  ASSERT_TRUE(end.Send(kGet));
  EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk);
}

TEST_F(HttpServerTlsTest, OneAddressCrowdsOutNobody) {
  HttpLimits limits = NetworkLimits();
  limits.request = absl::Seconds(20);
  Start(limits);
  // Far more than its places and its rate, in every state.
  const std::string hello = ClientHello();
  const auto silent = Many(20, "net-crowd", "");
  const auto half = Many(20, "net-crowd", hello.substr(0, 50));
  const auto whole = Many(20, "net-crowd", hello);
  for (int i = 0; i < 3; ++i) OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, TheNetworkTakesNoPlacesOfOrganisers) {
  Start(NetworkLimits());  // 20 places, 4 of them kept
  std::vector<std::unique_ptr<Client>> crowd;
  for (int address = 0; address < 10; ++address) {
    for (auto& client :
         Many(4, absl::StrCat("net-", std::string(1, static_cast<char>('a' + address))),
              ClientHello().substr(0, 50))) {
      crowd.push_back(std::move(client));
    }
  }
  std::vector<std::unique_ptr<Client>> organisers = Many(4, "root", "");
  for (const auto& organiser : organisers) {
    TlsEnd end(organiser->fd());
    ASSERT_TRUE(end.Handshake());
    ASSERT_TRUE(end.Send(kGet));
    EXPECT_EQ(end.Receive(sizeof(kOk) - 1), kOk);
  }
}

TEST_F(HttpServerTlsTest, AnswersThatAreRefusalsArriveWhole) {
  Start(Limits());
  Client client(path(), "net-a");
  TlsEnd end(client.fd());
  ASSERT_TRUE(end.Handshake());
  ASSERT_TRUE(end.Send("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9000000\r\n\r\n"));
  for (int i = 0; i < 90; ++i) end.Send(std::string(100'000, 'x'));
  EXPECT_THAT(end.Receive(100'000), StartsWith("HTTP/1.1 413 "));
}

TEST_F(HttpServerTlsTest, DamagedHandshakesEndAndHarmNobody) {
  Start(Limits());
  const std::string hello = ClientHello();
  std::mt19937 random(20241201);
  for (int round = 0; round < 300; ++round) {
    std::string bytes = hello;
    switch (round % 3) {
      case 0:  // nothing that TLS knows
        for (char& byte : bytes) byte = static_cast<char>(random());
        break;
      case 1:  // some bytes are others
        for (int i = 0; i < 4; ++i) bytes[random() % bytes.size()] = static_cast<char>(random());
        break;
      default:  // a whole one, and something else after it
        for (int i = 0; i < 200; ++i) bytes += static_cast<char>(random());
    }
    Client client(path(), absl::StrCat("net-", std::string(1, static_cast<char>('a' + round % 7))));
    client.Send(bytes);
    if (round % 2 == 0) client.EndSending();
    if (round % 50 == 0) OthersAreServedByTls();
  }
  OthersAreServedByTls();
}

TEST_F(HttpServerTlsTest, DamagedRecordsEndAndHarmNobody) {
  Start(Limits());
  std::mt19937 random(20241202);
  for (int round = 0; round < 100; ++round) {
    Client client(path(), absl::StrCat("net-", std::string(1, static_cast<char>('a' + round % 7))));
    TlsEnd end(client.fd());
    ASSERT_TRUE(end.Handshake());
    if (round % 2 == 0) {
      ASSERT_TRUE(end.Send(Upload(100'000).substr(0, random() % 60)));
    }
    std::string record = std::string("\x17\x03\x03", 3);
    const auto size = static_cast<uint16_t>(random());
    record += static_cast<char>(size >> 8);
    record += static_cast<char>(size & 0xff);
    for (size_t i = random() % (size + 1u); i > 0; --i) record += static_cast<char>(random());
    client.Send(record);
    client.EndSending();
    client.AwaitHangUp();
  }
  OthersAreServedByTls();
}

}  // namespace
}  // namespace myograde::server
