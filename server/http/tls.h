// The server's certificate, and what of TLS is spoken.
#pragma once

#include <absl/status/statusor.h>

#include <boost/asio/ssl/context.hpp>
#include <memory>
#include <string>

namespace myograde::server {

// A certificate with its key; versions 1.2 and 1.3 of TLS with forward secrecy, without
// renegotiation, sessions that could be resumed, or compression. Safe from any thread, as it never
// changes.
class TlsContext {
 public:
  // Reads a certificate with the chain that leads from it, and its private key, from files in PEM.
  // InvalidArgumentError: one sentence that names the file and what is wrong with it.
  static absl::StatusOr<std::shared_ptr<TlsContext>> Load(const std::string& certificate,
                                                          const std::string& key);

  // What users of the certificate will notice, or will soon, as a sentence: it is expired or not
  // valid yet, or its key is open to others. "" if there is nothing.
  const std::string& warning() const { return warning_; }

  // For streams of the server's end of connections.
  boost::asio::ssl::context& context() { return context_; }

 private:
  TlsContext(boost::asio::ssl::context context, std::string warning)
      : context_(std::move(context)), warning_(std::move(warning)) {}

  boost::asio::ssl::context context_;
  const std::string warning_;
};

}  // namespace myograde::server
