#include "server/api/transport.h"

#include <sys/epoll.h>
#include <sys/socket.h>

#include <cerrno>

namespace myograde::server {
namespace {

Transport::Moved AfterCall(ssize_t n) {
  if (n > 0) return {Transport::Outcome::kDone, static_cast<size_t>(n)};
  if (n == 0) return {Transport::Outcome::kEnded};
  const bool later = errno == EAGAIN || errno == EWOULDBLOCK;
  return {later ? Transport::Outcome::kBlocked : Transport::Outcome::kLost};
}

class PlainTransport : public Transport {
 public:
  explicit PlainTransport(int fd) : fd_(fd) {}

  bool established() const override { return true; }
  Outcome Handshake() override { return Outcome::kDone; }
  bool met_plain_http() const override { return false; }

  Moved Read(char* to, size_t size) override {
    ssize_t n;
    do {
      n = ::recv(fd_, to, size, MSG_DONTWAIT);
    } while (n < 0 && errno == EINTR);
    return AfterCall(n);
  }

  size_t pending() const override { return 0; }

  Moved Write(std::string_view bytes) override {
    ssize_t n;
    do {
      n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    } while (n < 0 && errno == EINTR);
    return AfterCall(n);
  }

  void EndSending() override { ::shutdown(fd_, SHUT_WR); }

  uint32_t Wants(bool to_send) const override { return to_send ? EPOLLOUT : EPOLLIN; }

 private:
  const int fd_;
};

}  // namespace

std::unique_ptr<Transport> MakePlainTransport(int fd) {
  return std::make_unique<PlainTransport>(fd);
}

}  // namespace myograde::server
