// The daemon's TCP port, with TLS, or with plain HTTP for a proxy on this host.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <boost/asio/ssl/context.hpp>
#include <memory>
#include <string>
#include <thread>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"
#include "server/config/server_config.h"
#include "server/http/acceptor.h"

namespace myograde::server {

// A certificate with its key; versions 1.2 and 1.3 of TLS with forward secrecy, without
// renegotiation, sessions that could be resumed, or compression. Safe from any thread, as it never
// changes.
struct TlsContext {
  // Reads a certificate with the chain that leads from it, and its private key, from files in PEM.
  // InvalidArgumentError: one sentence that names the file and what is wrong with it.
  static absl::StatusOr<std::shared_ptr<TlsContext>> Load(const std::string& certificate,
                                                          const std::string& key);

  boost::asio::ssl::context context;  // for streams of the server's end of connections
  // What users of the certificate will notice, or will soon, as a sentence: it is expired or not
  // valid yet, or its key is open to others. "" if there is nothing.
  std::string warning;
};

// Whether `config` names a certificate and a key that belong together; nothing if it is for plain
// HTTP. As Open, but touches no socket.
absl::Status CheckCertificate(const ListenConfig& config);

class TcpListener {
 public:
  // Reads the certificate and listens on the port, or takes `handed`, a TCP socket that listens
  // already, in place of the config's address and port. Errors are one sentence each:
  // InvalidArgumentError about the certificate, its key or the address, AlreadyExistsError if the
  // port is taken.
  static absl::StatusOr<std::unique_ptr<TcpListener>> Open(const ListenConfig& config,
                                                           Fd handed = Fd());
  ~TcpListener();
  TcpListener(const TcpListener&) = delete;
  TcpListener& operator=(const TcpListener&) = delete;

  // For the server, which must be gone before this object is.
  Listener listener();
  // With the port that was chosen, if it was left to the kernel: "https://192.0.2.1:8443".
  const std::string& url() const { return url_; }

  // From any thread, and from a signal handler: reads certificate and key again soon. Connections
  // from then on get the new ones; a pair that can't be used is logged and changes nothing.
  void Reload();

 private:
  TcpListener(ListenConfig config, Fd socket, std::string url,
              std::shared_ptr<TlsContext> context);
  void AwaitReloads();
  void ReadAgain();

  const ListenConfig config_;
  const Fd socket_;
  const std::string url_;
  Fd wake_;
  Mutex mutex_;
  std::shared_ptr<TlsContext> context_ ABSL_GUARDED_BY(mutex_);  // nullptr: plain HTTP
  std::thread reloader_;
};

}  // namespace myograde::server
