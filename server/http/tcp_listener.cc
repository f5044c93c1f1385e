#include "server/http/tcp_listener.h"

#include <absl/strings/str_cat.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
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

Place FindPlace(int fd) {
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

constexpr int kWarnDays = 14;  // before a certificate expires
// For TLS 1.2; all of 1.3's have forward secrecy.
constexpr char kCiphers[] = "ECDHE+AESGCM:ECDHE+CHACHA20";

absl::Status WrongFile(const std::string& path, std::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": ", absl::string_view(what.data(), what.size()),
                   "; correct \"http\": {\"listen\": …} in server.json, or the file"));
}

// OpenSSL's own words on what went wrong last.
std::string TlsReason() {
  const char* reason = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return reason == nullptr ? "unknown" : reason;
}

absl::Status CheckFileReadable(const std::string& path, const char* what) {
  if (::access(path.c_str(), R_OK) == 0) return absl::OkStatus();
  return WrongFile(path, absl::StrCat("the ", what, " can't be read (", std::strerror(errno), ")"));
}

// OpenSSL would ask for it on the daemon's terminal.
int NoPassphrase(char*, int, int, void* asked) {
  if (asked != nullptr) *static_cast<bool*>(asked) = true;
  return -1;
}

using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

absl::StatusOr<Key> ReadKey(const std::string& path) {
  RETURN_IF_ERROR(CheckFileReadable(path, "key"));
  const std::unique_ptr<BIO, decltype(&BIO_free)> file(BIO_new_file(path.c_str(), "r"), BIO_free);
  bool asked = false;
  Key key(file == nullptr ? nullptr
                          : PEM_read_bio_PrivateKey(file.get(), nullptr, NoPassphrase, &asked),
          EVP_PKEY_free);
  if (key != nullptr) return key;
  const std::string reason = TlsReason();
  if (asked)
    return WrongFile(path, "the key has a passphrase, which nobody can enter here; store it "
                           "without one");
  return WrongFile(path, absl::StrCat("holds no private key in PEM (", reason, ")"));
}

std::string WarningOf(const std::string& path, const X509* certificate, const std::string& key) {
  if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0) {
    return absl::StrCat(path,
                        ": the certificate has expired, so clients will refuse it; renew it and "
                        "send SIGHUP");
  }
  if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0) {
    return absl::StrCat(path,
                        ": the certificate is not valid yet, so clients will refuse it; check "
                        "it and this host's clock");
  }
  int days = 0;
  int seconds = 0;
  if (ASN1_TIME_diff(&days, &seconds, nullptr, X509_get0_notAfter(certificate)) == 1 &&
      days < kWarnDays) {
    return absl::StrCat(path, ": the certificate expires in ", Counted(days, "day"),
                        "; renew it and send SIGHUP");
  }
  struct stat info;
  if (::stat(key.c_str(), &info) == 0 && (info.st_mode & S_IROTH) != 0) {
    return absl::StrCat(key,
                        ": every user of this host can read the key; take that right away "
                        "(chmod o-r)");
  }
  return "";
}

void SetRules(SSL_CTX* context) {
  SSL_CTX_set_default_passwd_cb(context, NoPassphrase);
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  SSL_CTX_set_cipher_list(context, kCiphers);
  // An end of the connection without TLS's own is taken for one: HTTP knows its lengths itself.
  SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_NO_TICKET |
                                   SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_IGNORE_UNEXPECTED_EOF);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_num_tickets(context, 0);
}

absl::StatusOr<std::shared_ptr<TlsContext>> LoadContext(const ListenConfig& config) {
  if (config.certificate.empty()) return nullptr;
  return TlsContext::Load(config.certificate, config.key);
}

void LogWarning(const TlsContext* context) {
  if (context != nullptr && !context->warning.empty()) spdlog::warn("{}", context->warning);
}

}  // namespace

absl::StatusOr<std::shared_ptr<TlsContext>> TlsContext::Load(const std::string& certificate,
                                                             const std::string& key) {
  ERR_clear_error();
  boost::asio::ssl::context owner(boost::asio::ssl::context::tls_server);
  SSL_CTX* const context = owner.native_handle();
  SetRules(context);
  RETURN_IF_ERROR(CheckFileReadable(certificate, "certificate"));
  if (SSL_CTX_use_certificate_chain_file(context, certificate.c_str()) != 1) {
    return WrongFile(certificate, absl::StrCat("holds no certificate in PEM that can be used (",
                                               TlsReason(), ")"));
  }
  ASSIGN_OR_RETURN(const Key private_key, ReadKey(key));
  const X509* own = SSL_CTX_get0_certificate(context);
  if (X509_check_private_key(own, private_key.get()) != 1) {
    ERR_clear_error();
    return WrongFile(key, absl::StrCat("is not the key of the certificate ", certificate));
  }
  if (SSL_CTX_use_PrivateKey(context, private_key.get()) != 1) {
    return WrongFile(key, absl::StrCat("the key can't be used (", TlsReason(), ")"));
  }
  return std::make_shared<TlsContext>(
      TlsContext{std::move(owner), WarningOf(certificate, own, key)});
}

absl::Status CheckCertificate(const ListenConfig& config) { return LoadContext(config).status(); }

absl::StatusOr<std::unique_ptr<TcpListener>> TcpListener::Open(const ListenConfig& config,
                                                               Fd handed) {
  const std::optional<IpAddress> address = IpAddress::Parse(config.address);
  if (!address.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(config.address, ": is not an IP address"));
  }
  if (handed.valid()) {
    RETURN_IF_ERROR(CheckHanded(config, FindPlace(handed.get())));
  }
  ASSIGN_OR_RETURN(std::shared_ptr<TlsContext> context, LoadContext(config));
  ASSIGN_OR_RETURN(Fd socket,
                   handed.valid() ? std::move(handed) : ListenOn(
                       *address, static_cast<uint16_t>(config.port),
                       absl::StrCat(address->UrlHost(), ":", config.port)));
  LogWarning(context.get());
  const Place place = FindPlace(socket.get());
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
