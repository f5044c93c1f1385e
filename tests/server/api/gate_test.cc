// The gate with a worker that answers "ok": hostile peers of all kinds, and others
// who are answered all the same. A peer is named by the address that its socket is
// bound to.
#include "server/api/gate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr char kGet[] = "GET / HTTP/1.1\r\n\r\n";
constexpr char kOk[] = "HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok";

HttpLimits Limits() {
  HttpLimits limits;
  limits.workers = 2;
  limits.clients = 20;
  limits.organiser_clients = 4;
  limits.peer_clients = 10;
  limits.request = absl::Seconds(60);
  limits.upload = absl::Seconds(60);
  limits.idle = absl::Seconds(60);
  limits.body_bytes = 1 << 20;
  limits.min_bytes_per_s = 1;
  limits.speed_window = absl::Seconds(60);
  return limits;
}

class Client {
 public:
  Client(const std::string& server, const std::string& peer) {
    static std::atomic<int> number = 0;
    fd_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const std::string name = absl::StrCat(std::string(1, '\0'), "gate-", getpid(), "-", ++number, "-", peer);
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
    // A server that has hung up takes nothing, and what it said is still to be read.
    while (!text.empty()) {
      const ssize_t n = send(fd_.get(), text.data(), text.size(), MSG_NOSIGNAL);
      if (n <= 0) return;
      text.remove_prefix(static_cast<size_t>(n));
    }
  }
  // Waits until as many bytes are there, or the other end hung up.
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
  void AwaitHangUp() {
    pollfd entry = {fd_.get(), 0, 0};
    EXPECT_EQ(poll(&entry, 1, 60'000), 1);
  }
  void EndSending() { shutdown(fd_.get(), SHUT_WR); }
  int fd() const { return fd_.get(); }

 private:
  Fd fd_;
};

class GateTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "gate-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    if (gate_ != nullptr) {
      gate_->Stop();
      queue_.Close();
      runner_.join();
      for (std::thread& worker : workers_) worker.join();
      gate_.reset();
    }
    EXPECT_THAT(Spooled(), IsEmpty());
    std::filesystem::remove_all(folder_);
  }

  void Start(const HttpLimits& limits) {
    listener_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    sockaddr_un own = {};
    own.sun_family = AF_UNIX;
    path().copy(own.sun_path, sizeof(own.sun_path) - 1);
    ASSERT_EQ(bind(listener_.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0);
    ASSERT_EQ(listen(listener_.get(), 1024), 0);
    const SpoolOptions spool = {folder_, 1, &budget_};
    gate_ = std::make_unique<Gate>(
        Gate::Options{.limits = limits, .spool = spool, .peer_of = PeerOf,
                      .rule_of = [](const RequestHead& head) {
                        if (head.path == "/upload") {
                          return BodyRule{.most = 8 << 20, .upload = true, .types = {"application/x-tar"}};
                        }
                        return BodyRule{.most = 100'000, .types = {"application/json"}};
                      }},
        queue_);
    runner_ = std::thread([this] { gate_->Run(listener_.get()); });
    for (int i = 0; i < limits.workers; ++i) {
      workers_.emplace_back([this, spool] { WorkAt(spool); });
    }
  }

  void WorkAt(const SpoolOptions& spool) {
    while (std::optional<Job> job = queue_.Pop()) {
      Connection& connection = *job->connection;
      if (job->work == WorkKind::kSpool) {
        connection.next = connection.Spool(spool);
      } else {
        const absl::StatusOr<std::string> body = connection.body.Text();
        body_bytes_ += body.ok() ? std::ssize(*body) : -1'000'000'000;
        connection.out += connection.head->path == "/large"
                              ? absl::StrCat("HTTP/1.1 200 OK\r\nContent-Length: ", kLarge, "\r\n\r\n",
                                             std::string(kLarge, 'x'))
                              : kOk;
        connection.close_after = !connection.head->keep_alive;
        connection.next = connection.Send() ? Connection::Next::kSend : Connection::Next::kClose;
      }
      queue_.Done(*job);
      gate_->Return(&connection);
    }
  }

  static std::optional<Peer> PeerOf(int fd) {
    sockaddr_un other = {};
    socklen_t size = sizeof(other);
    if (getpeername(fd, reinterpret_cast<sockaddr*>(&other), &size) != 0) return std::nullopt;
    const std::string name(other.sun_path, size - offsetof(sockaddr_un, sun_path));
    const std::string key = name.substr(name.rfind('-') + 1);
    return Peer{key, key == "root", 1};
  }

  std::string path() const { return folder_ + "/s"; }
  std::vector<std::string> Spooled() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      const std::string name = entry.path().filename();
      if (name != "s") names.push_back(name);
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

  static constexpr size_t kLarge = 4 << 20;
  std::string folder_;
  SpoolBudget budget_{64 << 20, 16 << 20};
  WorkQueue queue_{{.workers = 2, .kept = 1, .of_a_peer = 1, .of_a_kind = {2, 1, 1, 1}}};
  std::unique_ptr<Gate> gate_;
  Fd listener_;
  std::thread runner_;
  std::vector<std::thread> workers_;
  std::atomic<int64_t> body_bytes_ = 0;
};

std::string Upload(int64_t size) {
  return absl::StrCat("POST /upload HTTP/1.1\r\nContent-Length: ", size, "\r\n\r\n");
}

TEST_F(GateTest, ServesRequestsThatFollowOneAnother) {
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

TEST_F(GateTest, BodiesOfAnySizeAndFramingArriveWhole) {
  Start(Limits());
  int64_t sent = 0;
  for (const int64_t size : {1, 65'536, 65'537, 300'000, 5'000'000}) {
    Client client(path(), "a");
    client.Send(Upload(size) + std::string(static_cast<size_t>(size), 'x'));
    EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk) << size;
    EXPECT_EQ(body_bytes_, sent += size);
    client.Send("POST /upload HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n");
    for (int64_t left = size; left > 0; left -= 50'000) {
      const auto chunk = static_cast<size_t>(std::min<int64_t>(left, 50'000));
      client.Send(absl::StrCat(absl::Hex(chunk), "\r\n", std::string(chunk, 'y'), "\r\n"));
    }
    client.Send("0\r\n\r\n");
    EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk) << size;
    EXPECT_EQ(body_bytes_, sent += size);
  }
}

TEST_F(GateTest, WhoAsksFirstHearsToGoOnOrWhyNot) {
  Start(Limits());
  Client client(path(), "a");
  client.Send("POST /upload HTTP/1.1\r\nContent-Length: 4\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(client.Receive(25), "HTTP/1.1 100 Continue\r\n\r\n");
  client.Send("body");
  EXPECT_EQ(client.Receive(sizeof(kOk) - 1), kOk);
  client.Send("POST /upload HTTP/1.1\r\nContent-Length: 9000000\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_THAT(client.Receive(12), "HTTP/1.1 413");
}

TEST_F(GateTest, ARefusedBodyIsReadSoThatItsSenderHearsWhy) {
  Start(Limits());
  for (const char* head : {"POST /upload HTTP/1.1\r\nContent-Length: 20000000\r\n\r\n",
                           "POST /upload HTTP/1.1\r\nContent-Length: 5000000\r\n"
                           "Content-Type: multipart/form-data; boundary=x\r\n\r\n"}) {
    Client client(path(), "a");
    client.Send(head);
    client.Send(std::string(5'000'000, 'x'));  // would fail half-way if nobody read it
    EXPECT_THAT(client.Receive(10), "HTTP/1.1 4");
  }
  EXPECT_EQ(body_bytes_, 0);
}

TEST_F(GateTest, OneSendersDiskIsBounded) {
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

TEST_F(GateTest, SilentBodiesHalfHeadsAndIdleConnectionsHoldUpNobody) {
  Start(Limits());
  for (const std::string& text : {Upload(1000) + "x", Upload(1 << 20) + "x", std::string("GET /v"),
                                  std::string()}) {
    const auto crowd = Many(30, "crowd", text);
    const auto more = Many(30, "root", text);
    OthersAreServed();
    // Those of the crowd's own user too, once what it has asked nothing with gives way.
    if (text.empty()) {
      EXPECT_EQ(Client(path(), "crowd").Ask(), kOk);
    }
  }
}

TEST_F(GateTest, WhoDoesNotReadItsAnswersHoldsUpNobody) {
  Start(Limits());
  const auto crowd = Many(10, "crowd", "GET /large HTTP/1.1\r\n\r\n");
  for (int i = 0; i < 5; ++i) OthersAreServed();
  EXPECT_EQ(crowd[0]->Receive(kLarge).size(), kLarge);
}

TEST_F(GateTest, TheSlowAreHungUpOn) {
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
  unread.Send("GET /large HTTP/1.1\r\n\r\n");
  Client honest(path(), "a");
  honest.Send(Upload(30'000));
  for (int i = 0; i < 30; ++i) {
    honest.Send(std::string(1000, 'x'));
    absl::SleepFor(absl::Milliseconds(200));  // fifty times as fast as must be
  }
  EXPECT_EQ(honest.Receive(sizeof(kOk) - 1), kOk);
  EXPECT_THAT(silent.Receive(12), "HTTP/1.1 408");
  EXPECT_THAT(large.Receive(12), "HTTP/1.1 408");
  EXPECT_THAT(half.Receive(12), "HTTP/1.1 408");
  unread.AwaitHangUp();
  EXPECT_LT(unread.Receive(kLarge).size(), kLarge);
}

TEST_F(GateTest, IdleConnectionsEnd) {
  HttpLimits limits = Limits();
  limits.idle = absl::Milliseconds(300);
  Start(limits);
  Client client(path(), "a");
  EXPECT_EQ(client.Ask(), kOk);
  EXPECT_TRUE(client.HungUp(absl::Seconds(60)));
}

TEST_F(GateTest, BodiesAreRefusedBeforeAStop) {
  Start(Limits());
  Client body(path(), "a");
  body.Send(Upload(1000) + "x");
  Client large(path(), "a");
  large.Send(Upload(1'000'000) + std::string(70'000, 'x'));
  EXPECT_EQ(Client(path(), "b").Ask(), kOk);
  gate_->Drain();
  EXPECT_THAT(body.Receive(12), "HTTP/1.1 503");
  EXPECT_THAT(large.Receive(12), "HTTP/1.1 503");
  EXPECT_EQ(Client(path(), "b").Ask(), kOk);
}

TEST_F(GateTest, WithoutDescriptorsItWaitsAndOrganisersAreServed) {
  Start(Limits());
  OthersAreServed();
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  std::vector<Fd> hoard;
  const rlimit low = {256, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  // This process is server and clients: sockets first, then none is left to accept with.
  std::vector<Fd> waiting;
  for (int i = 0; i < 20; ++i) waiting.emplace_back(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  for (;;) {
    Fd fd(dup(0));
    if (!fd.valid()) break;
    hoard.push_back(std::move(fd));
  }
  sockaddr_un to = {};
  to.sun_family = AF_UNIX;
  path().copy(to.sun_path, sizeof(to.sun_path) - 1);
  for (size_t i = 0; i < waiting.size(); ++i) {
    const std::string peer = i + 1 == waiting.size() ? "root" : "stranger";
    const std::string name = absl::StrCat(std::string(1, '\0'), "gate-", getpid(), "-w", i, "-", peer);
    sockaddr_un own = {};
    own.sun_family = AF_UNIX;
    name.copy(own.sun_path, sizeof(own.sun_path));
    ASSERT_EQ(bind(waiting[i].get(), reinterpret_cast<const sockaddr*>(&own),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())), 0);
    ASSERT_EQ(connect(waiting[i].get(), reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
    // Who is refused already has nothing to say any more.
    const ssize_t n = send(waiting[i].get(), kGet, sizeof(kGet) - 1, MSG_NOSIGNAL);
    ASSERT_TRUE(n > 0 || peer != "root");
  }
  const auto answer = [](int fd) {
    pollfd entry = {fd, POLLIN, 0};
    char buffer[64];
    if (poll(&entry, 1, 60'000) <= 0) return std::string("nothing");
    const ssize_t n = recv(fd, buffer, 12, 0);
    return std::string(buffer, static_cast<size_t>(std::max<ssize_t>(n, 0)));
  };
  EXPECT_EQ(answer(waiting.back().get()), "HTTP/1.1 200");
  // The end of an earlier connection may have left one more place.
  EXPECT_EQ(answer(waiting[10].get()), "HTTP/1.1 503");
  hoard.clear();
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  EXPECT_EQ(Client(path(), "late").Ask(), kOk);
}

}  // namespace
}  // namespace myograde::server
