#include "server/http/tcp_listener.h"

#include <absl/strings/str_cat.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"

namespace myograde::server {
namespace {

constexpr int kTcpBacklog = 1024;
// What wakes the reloader; the higher one is told apart in a sum.
constexpr uint64_t kReload = 1;
constexpr uint64_t kEnd = uint64_t{1} << 32;

void Wake(int eventfd, uint64_t value) {
  [[maybe_unused]] const ssize_t n = ::write(eventfd, &value, sizeof(value));
}

absl::Status CantListen(const std::string& where) {
  const int error = errno;
  if (error == EADDRINUSE) {
    return absl::AlreadyExistsError(absl::StrCat(
        where,
        ": another program listens there; stop it, or choose another port for \"http\": "
        "{\"listen\": …} in server.json"));
  }
  const char* advice = error == EADDRNOTAVAIL ? "; no interface of this host has the address"
                       : error == EACCES      ? "; ports below 1024 need root or a capability"
                                              : "";
  return absl::InvalidArgumentError(
      absl::StrCat(where, ": can't be listened on (", std::strerror(error), ")", advice,
                   "; correct \"http\": {\"listen\": …} in server.json"));
}

absl::StatusOr<Fd> ListenOn(const IpAddress& address, uint16_t port, const std::string& where) {
  socklen_t size = 0;
  const sockaddr_storage place = address.SocketAddress(port, size);
  Fd fd(::socket(place.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!fd.valid()) return CantListen(where);
  const int on = 1;
  const int off = 0;
  // A restart need not wait for connections of before to be forgotten.
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  // Connections inherit it: answers go out at once, whole or in large pieces.
  ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  // "::" is for both versions, whatever the host's default.
  if (place.ss_family == AF_INET6) {
    ::setsockopt(fd.get(), IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof(off));
  }
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&place), size) != 0 ||
      ::listen(fd.get(), kTcpBacklog) != 0) {
    return CantListen(where);
  }
  return fd;
}

// Where a socket listens.
struct Place {
  std::optional<IpAddress> address;
  uint16_t port = 0;
};

Place PlaceOf(int fd) {
  sockaddr_storage own = {};
  socklen_t size = sizeof(own);
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) != 0) return {};
  // The port is at the same place for both versions.
  return {IpAddress::Of(own), ntohs(reinterpret_cast<const sockaddr_in&>(own).sin_port)};
}

// A socket of the service manager's is at an address that no config was checked for.
absl::Status CheckHanded(const ListenConfig& config, const Place& place) {
  if (!place.address.has_value()) {
    return absl::InvalidArgumentError(
        "the service manager's TCP socket has no address; give its socket unit a ListenStream= "
        "with a port");
  }
  if (place.address->IsLoopback() || (!config.certificate.empty() && !config.behind_proxy)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat(
      place.address->UrlHost(), ":", place.port, ": the service manager listens there for "
      "everybody, but \"listen\" in server.json is for this host only; add certificate and key (and "
      "no behind_proxy), or give the socket unit ListenStream=127.0.0.1:", place.port));
}

// Who is at the other end, by the address. Nobody from the network is an organiser here,
// whatever its requests may show later.
std::optional<Peer> PeerAt(int fd, bool behind_proxy, bool plain) {
  sockaddr_storage other = {};
  socklen_t size = sizeof(other);
  if (::getpeername(fd, reinterpret_cast<sockaddr*>(&other), &size) != 0) return std::nullopt;
  const std::optional<IpAddress> address = IpAddress::Of(other);
  if (!address.has_value()) return std::nullopt;
  return Peer{.key = address->Key(), .network = true, .proxy = behind_proxy,
              .local = plain && !behind_proxy};
}

absl::StatusOr<std::shared_ptr<TlsContext>> LoadContext(const ListenConfig& config) {
  if (config.certificate.empty()) return nullptr;
  return TlsContext::Load(config.certificate, config.key);
}

void LogWarning(const TlsContext* context) {
  if (context != nullptr && !context->warning().empty()) spdlog::warn("{}", context->warning());
}

}  // namespace

absl::Status CheckCertificate(const ListenConfig& config) { return LoadContext(config).status(); }

absl::StatusOr<std::unique_ptr<TcpListener>> TcpListener::Open(const ListenConfig& config,
                                                               Fd handed) {
  const std::optional<IpAddress> address = IpAddress::Parse(config.address);
  if (!address.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(config.address, ": is no IP address"));
  }
  if (handed.valid()) {
    RETURN_IF_ERROR(CheckHanded(config, PlaceOf(handed.get())));
  }
  ASSIGN_OR_RETURN(std::shared_ptr<TlsContext> context, LoadContext(config));
  ASSIGN_OR_RETURN(Fd socket,
                   handed.valid() ? std::move(handed) : ListenOn(
                       *address, static_cast<uint16_t>(config.port),
                       absl::StrCat(address->UrlHost(), ":", config.port)));
  LogWarning(context.get());
  const Place place = PlaceOf(socket.get());
  std::string url = absl::StrCat(context == nullptr ? "http" : "https", "://",
                                 place.address.value_or(*address).UrlHost(), ":", place.port);
  return std::unique_ptr<TcpListener>(
      new TcpListener(config, std::move(socket), std::move(url), std::move(context)));
}

TcpListener::TcpListener(ListenConfig config, Fd socket, std::string url,
                         std::shared_ptr<TlsContext> context)
    : config_(std::move(config)),
      socket_(std::move(socket)),
      url_(std::move(url)),
      wake_(::eventfd(0, EFD_CLOEXEC)),
      context_(std::move(context)) {
  // Files may lie on a disk that hangs, so no thread that serves anybody reads them.
  if (!config_.certificate.empty()) reloader_ = std::thread([this] { AwaitReloads(); });
}

TcpListener::~TcpListener() {
  Wake(wake_.get(), kEnd);
  if (reloader_.joinable()) reloader_.join();
}

Listener TcpListener::listener() {
  Listener listener{.fd = socket_.get(),
                    .peer_of = [proxy = config_.behind_proxy, plain = config_.certificate.empty()](
                                   int fd) { return PeerAt(fd, proxy, plain); },
                    .tls_of = {}};
  if (config_.certificate.empty()) return listener;
  listener.tls_of = [this] {
    const MutexLock lock(mutex_);
    return context_;
  };
  return listener;
}

void TcpListener::Reload() { Wake(wake_.get(), kReload); }

void TcpListener::AwaitReloads() {
  for (;;) {
    uint64_t asked = 0;
    const ssize_t n = ::read(wake_.get(), &asked, sizeof(asked));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 || asked >= kEnd) return;
    ReadAgain();
  }
}

void TcpListener::ReadAgain() {
  absl::StatusOr<std::shared_ptr<TlsContext>> context = LoadContext(config_);
  if (!context.ok()) {
    spdlog::error("the certificate stays as it was: {}", std::string(context.status().message()));
    return;
  }
  LogWarning(context->get());
  const MutexLock lock(mutex_);
  context_ = *std::move(context);
  spdlog::info("{}: this certificate is used from now on", config_.certificate);
}

}  // namespace myograde::server
