// A server that answers "ok", and clients for it. A peer is identified by the address that its socket
// is bound to; those whose names begin with "net" come from the network, "proxy" through one.
#pragma once

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <semaphore>
#include <string>
#include <thread>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/clock.h"
#include "server/http/http_server.h"

namespace myograde::server {

inline constexpr char kGet[] = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
// Answered when the test permits it.
inline constexpr char kWait[] = "GET /wait HTTP/1.1\r\nHost: localhost\r\n\r\n";
inline constexpr char kOk[] = "HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok";

inline HttpLimits Limits() {
  HttpLimits limits;
  limits.workers = 2;
  limits.clients = 20;
  limits.organiser_clients = 4;
  limits.peer_clients = 10;
  limits.request = absl::Seconds(60);
  limits.upload = absl::Seconds(60);
  limits.idle = absl::Seconds(60);
  limits.body_bytes = 100'000;
  limits.spool_bytes = 64 << 20;
  limits.peer_spool_bytes = 16 << 20;
  limits.disk_reserve = 1;
  limits.min_bytes_per_s = 1;
  limits.speed_window = absl::Seconds(60);
  return limits;
}

class Client {
 public:
  Client(const std::string& server, const std::string& peer) {
    static std::atomic<int> number = 0;
    fd_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const std::string name = absl::StrCat(std::string(1, '\0'), "http-", getpid(), "-", ++number, "-", peer);
    sockaddr_un own = {};
    own.sun_family = AF_UNIX;
    name.copy(own.sun_path, sizeof(own.sun_path));
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    EXPECT_EQ(bind(fd_.get(), reinterpret_cast<const sockaddr*>(&own), size), 0);
    sockaddr_un to = {};
    to.sun_family = AF_UNIX;
    server.copy(to.sun_path, sizeof(to.sun_path) - 1);
    EXPECT_EQ(connect(fd_.get(), reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
  }
  void Send(std::string_view text) {
    // A server that has hung up accepts nothing more, but what it sent must still be readable.
    while (!text.empty()) {
      const ssize_t n = send(fd_.get(), text.data(), text.size(), MSG_NOSIGNAL);
      if (n <= 0) return;
      text.remove_prefix(static_cast<size_t>(n));
    }
  }
  // Waits for `size` bytes, or until the other end hangs up.
  std::string Receive(size_t size, absl::Duration patience = absl::Seconds(60)) {
    const absl::Duration end = SystemClock().Monotonic() + patience;
    std::string text;
    while (text.size() < size && SystemClock().Monotonic() < end) {
      pollfd entry = {fd_.get(), POLLIN, 0};
      if (poll(&entry, 1, 50) <= 0) continue;
      char buffer[4096];
      const ssize_t n = recv(fd_.get(), buffer, std::min(sizeof(buffer), size - text.size()), 0);
      if (n <= 0) break;
      text.append(buffer, static_cast<size_t>(n));
    }
    return text;
  }
  std::string Ask() {
    Send(kGet);
    return Receive(sizeof(kOk) - 1);
  }
  bool HungUp(absl::Duration patience) {
    const absl::Duration end = SystemClock().Monotonic() + patience;
    while (SystemClock().Monotonic() < end) {
      pollfd entry = {fd_.get(), POLLIN, 0};
      char byte;
      if (poll(&entry, 1, 50) > 0 && recv(fd_.get(), &byte, 1, 0) <= 0) return true;
    }
    return false;
  }
  // Without reading.
  void AwaitHangUp() { EXPECT_TRUE(Closed(absl::Seconds(60))); }
  // Whether the other end has hung up completely, rather than only finished sending.
  bool Closed(absl::Duration patience) {
    pollfd entry = {fd_.get(), 0, 0};
    return poll(&entry, 1, static_cast<int>(absl::ToInt64Milliseconds(patience))) == 1;
  }
  void EndSending() { shutdown(fd_.get(), SHUT_WR); }
  int fd() const { return fd_.get(); }

 private:
  Fd fd_;
};

class HttpServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "http-server-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    permits_.release(1000);
    server_.reset();
    EXPECT_THAT(Spooled(), ::testing::IsEmpty());
    std::filesystem::remove_all(folder_);
  }

  void Start(const HttpLimits& limits) {
    listener_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    sockaddr_un own = {};
    own.sun_family = AF_UNIX;
    path().copy(own.sun_path, sizeof(own.sun_path) - 1);
    ASSERT_EQ(bind(listener_.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0);
    ASSERT_EQ(listen(listener_.get(), 1024), 0);
    server_.emplace(limits, folder_);
    Add("GET", "/", [](Response&) {});
    Add("GET", "/wait", [this](Response&) { permits_.acquire(); });
    Add("GET", "/who", [](Response& response) {
      response.text = HttpServer::RequestConnection().Asker().key;
    });
    Add("GET", "/large", [](Response& response) { response.text = std::string(kLarge, 'x'); });
    Add("GET", "/file", [this](Response& response) {
      response.file = {Fd(::open(file().c_str(), O_RDONLY | O_CLOEXEC)), 0, kHuge};
      response.text.clear();
    });
    Add("POST", "/upload", [](Response&) {},
        {.most = 8 << 20, .upload = true, .types = {"application/x-tar"}});
    server_->StartWith({{.fd = listener_.get(), .peer_of = PeerOf, .tls_of = tls_of_}});
  }

  void Add(const std::string& method, const std::string& path,
           std::function<void(Response&)> serve, BodyRule body = {}) {
    server_->router().Add({method, path, Action::kReadApi,
                           [this, serve = std::move(serve)](const Request& request, Response& response) {
                             const absl::StatusOr<std::string> text = request.body->Text();
                             body_bytes_ += text.ok() ? std::ssize(*text) : -1'000'000'000;
                             response.text = "ok";
                             serve(response);
                           },
                           std::move(body)});
  }

  static std::optional<Peer> PeerOf(int fd) {
    sockaddr_un other = {};
    socklen_t size = sizeof(other);
    if (getpeername(fd, reinterpret_cast<sockaddr*>(&other), &size) != 0) return std::nullopt;
    const std::string name(other.sun_path, size - offsetof(sockaddr_un, sun_path));
    const std::string key = name.substr(name.rfind('-') + 1);
    return Peer{.key = key, .organiser = key == "root", .uid = 1, .network = key.starts_with("net"),
                .proxy = key == "proxy"};
  }

  std::string path() const { return folder_ + "/s"; }
  std::string file() const { return folder_ + "/file"; }  // served as "/file"
  std::vector<std::string> Spooled() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      const std::string name = entry.path().filename();
      if (name != "s" && name != "file") names.push_back(name);
    }
    return names;
  }
  std::vector<std::unique_ptr<Client>> Many(int count, const std::string& peer, const std::string& text) {
    std::vector<std::unique_ptr<Client>> clients;
    for (int i = 0; i < count; ++i) {
      clients.push_back(std::make_unique<Client>(path(), peer));
      clients.back()->Send(text);
    }
    return clients;
  }
  void OthersAreServed() {
    EXPECT_EQ(Client(path(), "honest").Ask(), kOk);
    EXPECT_EQ(Client(path(), "root").Ask(), kOk);
  }
  // The same when the crowd is the organiser's too: until the server has seen all of it, an
  // organiser's request may be told to retry later.
  void OthersAreServedSoon() {
    EXPECT_EQ(Client(path(), "honest").Ask(), kOk);
    std::string answer;
    const absl::Duration end = SystemClock().Monotonic() + absl::Seconds(30);
    while ((answer = Client(path(), "root").Ask()) != kOk && SystemClock().Monotonic() < end) {
      ASSERT_THAT(answer, ::testing::StartsWith("HTTP/1.1 429 "));
      absl::SleepFor(absl::Milliseconds(10));
    }
    EXPECT_EQ(answer, kOk);
  }

  // Once an organiser is answered, the server has seen everything that was sent before.
  void AwaitAllSeen() { EXPECT_EQ(Client(path(), "root").Ask(), kOk); }
  // Occupies all places of a peer with three requests each, which end only when permitted.
  std::vector<std::unique_ptr<Client>> AllBusy(const std::string& peer) {
    std::vector<std::unique_ptr<Client>> clients = Many(Limits().peer_clients, peer, "");
    for (const auto& client : clients) EXPECT_EQ(client->Ask(), kOk);
    for (const auto& client : clients) client->Send(absl::StrCat(kWait, kWait, kWait));
    AwaitAllSeen();
    return clients;
  }

  static constexpr size_t kLarge = 4 << 20;
  static constexpr int64_t kHuge = int64_t{1} << 30;
  std::counting_semaphore<> permits_{0};
  std::string folder_;
  std::function<std::shared_ptr<TlsContext>()> tls_of_;  // empty: plain HTTP
  Fd listener_;
  std::atomic<int64_t> body_bytes_ = 0;
  std::optional<HttpServer> server_;
};

inline std::string Upload(int64_t size) {
  return absl::StrCat("POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: ", size, "\r\n\r\n");
}

}  // namespace myograde::server
