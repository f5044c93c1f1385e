// The server's end of TLS over a pair of sockets, and what is wrong with certificates.
#include "server/api/tls.h"

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <thread>

#include "protocol/base/fd.h"
#include "server/api/connection.h"
#include "tests/server/api/certificate.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

class TlsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    signal(SIGPIPE, SIG_IGN);
    folder_ = absl::StrCat(testing::TempDir(), "/tls-", getpid());
    std::filesystem::create_directory(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const char* name) const { return folder_ + "/" + name; }
  std::string ErrorOf(const char* certificate, const char* key) const {
    return std::string(TlsContext::Load(path(certificate), path(key)).status().message());
  }
  std::string WarningAbout(absl::Duration from, absl::Duration until) const {
    MakeCertificate(path("cert"), path("key"), from, until);
    const auto context = TlsContext::Load(path("cert"), path("key"));
    EXPECT_TRUE(context.ok()) << context.status();
    return context.ok() ? (*context)->warning() : "";
  }

  // A connection whose handshake is done, and its other end.
  void Connect(int version) {
    MakeCertificate(path("cert"), path("key"));
    const auto context = TlsContext::Load(path("cert"), path("key"));
    ASSERT_TRUE(context.ok()) << context.status();
    int ends[2];
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    client_fd_ = Fd(ends[1]);
    ASSERT_EQ(fcntl(ends[0], F_SETFL, O_NONBLOCK), 0);
    connection_ = std::make_unique<Connection>(
        1, Fd(ends[0]), std::make_shared<PeerLoad>(Peer{"a"}), (*context)->Accept(ends[0]));
    client_ = std::make_unique<TlsEnd>(client_fd_.get(), version);
    std::future<bool> other =
        std::async(std::launch::async, [this] { return client_->Handshake(); });
    Connection::Next next;
    while ((next = connection_->Handshake()) == Connection::Next::kHandshake) AwaitServer();
    EXPECT_EQ(next, Connection::Next::kRead);
    EXPECT_TRUE(other.get());
    EXPECT_TRUE(connection_->transport->established());
  }
  void AwaitServer() {
    pollfd entry = {connection_->fd.get(),
                    static_cast<short>(connection_->transport->Wants(/*to_send=*/false)), 0};
    ASSERT_EQ(poll(&entry, 1, 60'000), 1);
  }

  std::string folder_;
  Fd client_fd_;
  std::unique_ptr<TlsEnd> client_;
  std::unique_ptr<Connection> connection_;
};

TEST_F(TlsTest, BytesArriveInBothDirections) {
  for (const int version : {TLS1_2_VERSION, TLS1_3_VERSION}) {
    Connect(version);
    ASSERT_TRUE(client_->Send("hello"));
    AwaitServer();
    EXPECT_TRUE(connection_->Read(1000));
    EXPECT_EQ(connection_->in, "hello");
    connection_->out = std::string(100'000, 'x');
    std::future<std::string> received =
        std::async(std::launch::async, [this] { return client_->Receive(100'000); });
    while (connection_->unsent() > 0) {
      ASSERT_TRUE(connection_->Send());
      if (connection_->unsent() == 0) break;
      pollfd entry = {connection_->fd.get(),
                      static_cast<short>(connection_->transport->Wants(/*to_send=*/true)), 0};
      ASSERT_EQ(poll(&entry, 1, 60'000), 1);
    }
    EXPECT_EQ(received.get(), std::string(100'000, 'x'));
    EXPECT_TRUE(connection_->Read(1000)) << "nothing has come, and nobody has left";
    connection_.reset();
    EXPECT_EQ(client_->Receive(1), "");
    EXPECT_EQ(SSL_get_shutdown(client_->ssl()) & SSL_RECEIVED_SHUTDOWN, SSL_RECEIVED_SHUTDOWN);
  }
}

// What OpenSSL has opened, the socket's readiness tells of no more.
TEST_F(TlsTest, NothingIsLeftBehindThatNobodyIsToldOf) {
  Connect(TLS1_3_VERSION);
  ASSERT_TRUE(client_->Send(std::string(5000, 'x')));
  AwaitServer();
  EXPECT_TRUE(connection_->Read(10));
  EXPECT_EQ(connection_->in.size(), 5000u);
  EXPECT_EQ(connection_->transport->pending(), 0u);
}

TEST_F(TlsTest, TheEndIsSeenWithAndWithoutAGoodbye) {
  Connect(TLS1_3_VERSION);
  SSL_shutdown(client_->ssl());
  AwaitServer();
  EXPECT_FALSE(connection_->Read(10));
  EXPECT_TRUE(connection_->ended);
  Connect(TLS1_2_VERSION);
  shutdown(client_fd_.get(), SHUT_WR);
  AwaitServer();
  EXPECT_FALSE(connection_->Read(10));
  EXPECT_TRUE(connection_->ended);
  connection_->out = "still heard";
  EXPECT_TRUE(connection_->Send());
  EXPECT_EQ(client_->Receive(11), "still heard");
}

TEST_F(TlsTest, ADamagedRecordEndsTheConnection) {
  Connect(TLS1_3_VERSION);
  const std::string record = std::string("\x17\x03\x03\x00\x20", 5) + std::string(32, 'z');
  ASSERT_EQ(write(client_fd_.get(), record.data(), record.size()), std::ssize(record));
  AwaitServer();
  EXPECT_FALSE(connection_->Read(1000));
  connection_->out = "more";
  EXPECT_FALSE(connection_->Send());
}

TEST_F(TlsTest, MistakesOfFilesAreNamed) {
  MakeCertificate(path("cert"), path("key"));
  MakeCertificate(path("other-cert"), path("other-key"));
  MakeCertificate(path("locked-cert"), path("locked-key"), -absl::Hours(1), absl::Hours(9999),
                  "secret");
  std::ofstream(path("text")) << "no PEM\n";
  EXPECT_THAT(ErrorOf("none", "key"),
              HasSubstr("none: the certificate can't be read (No such file"));
  EXPECT_THAT(ErrorOf("cert", "none"), HasSubstr("none: the key can't be read (No such file"));
  EXPECT_THAT(ErrorOf("text", "key"), HasSubstr("text: holds no certificate in PEM"));
  EXPECT_THAT(ErrorOf("cert", "text"), HasSubstr("text: holds no private key in PEM"));
  EXPECT_THAT(ErrorOf("cert", "cert"), HasSubstr("cert: holds no private key in PEM"));
  EXPECT_THAT(ErrorOf("cert", "other-key"), HasSubstr("is not the key of the certificate"));
  EXPECT_THAT(ErrorOf("locked-cert", "locked-key"), HasSubstr("the key has a passphrase"));
  EXPECT_EQ(ErrorOf("cert", "key"), "");
}

TEST_F(TlsTest, DatesThatClientsWillRefuseAreAWarning) {
  const absl::Duration day = absl::Hours(24);
  EXPECT_EQ(WarningAbout(-day, 100 * day), "");
  EXPECT_THAT(WarningAbout(-2 * day, -day), HasSubstr("has expired"));
  EXPECT_THAT(WarningAbout(day, 100 * day), HasSubstr("not valid yet"));
  EXPECT_THAT(WarningAbout(-day, 3 * day + absl::Hours(1)), HasSubstr("expires in 3 days"));
  MakeCertificate(path("cert"), path("key"));
  chmod(path("key").c_str(), 0644);
  EXPECT_THAT(TlsContext::Load(path("cert"), path("key")).value()->warning(),
              HasSubstr("every user of this host can read the key"));
}

}  // namespace
}  // namespace myograde::server
