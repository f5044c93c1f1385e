// The server's end of TLS, by OpenSSL, for sockets that do not block.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <openssl/ssl.h>

#include <memory>
#include <string>

#include "server/api/transport.h"

namespace myograde::server {

// A certificate with its key, and what of TLS is spoken: versions 1.2 and 1.3 with forward secrecy,
// without renegotiation, sessions that could be resumed, or compression. Never changes, so it is
// safe from any thread.
class TlsContext {
 public:
  // Reads a certificate with the chain that leads from it, and its private key, from files in PEM.
  // InvalidArgumentError: one sentence that names the file and what is wrong with it.
  static absl::StatusOr<std::shared_ptr<const TlsContext>> Load(const std::string& certificate,
                                                                const std::string& key);

  // What users of the certificate will notice, or will soon, as a sentence: it is expired or not
  // valid yet, or its key is open to others. "" if there is nothing.
  const std::string& warning() const { return warning_; }

  // The server's end of a connection over the socket `fd`, which must outlive it. SIGPIPE must be
  // ignored. nullptr if there is no memory.
  std::unique_ptr<Transport> Accept(int fd) const;

 private:
  struct Free {
    void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
  };
  using Context = std::unique_ptr<SSL_CTX, Free>;

  TlsContext(Context context, std::string warning)
      : context_(std::move(context)), warning_(std::move(warning)) {}

  const Context context_;
  const std::string warning_;
};

}  // namespace myograde::server
