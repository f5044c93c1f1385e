// Certificates for tests, and the client's end of TLS, which trusts anybody.
#pragma once

#include <absl/time/time.h>
#include <gtest/gtest.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>

#include <cstdio>
#include <memory>
#include <string>

namespace myograde::server {

// Writes a new key to `key_path` (with a passphrase, if there is one) and a certificate of it,
// signed by itself, to `path`. It is valid from `from` on until `until`, counted from now.
inline void MakeCertificate(const std::string& path, const std::string& key_path,
                            absl::Duration from = -absl::Hours(1),
                            absl::Duration until = absl::Hours(24 * 365),
                            const char* passphrase = nullptr) {
  EVP_PKEY* key = EVP_EC_gen("P-256");
  ASSERT_NE(key, nullptr);
  X509* certificate = X509_new();
  X509_set_version(certificate, X509_VERSION_3);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate), 1);
  X509_gmtime_adj(X509_getm_notBefore(certificate), absl::ToInt64Seconds(from));
  X509_gmtime_adj(X509_getm_notAfter(certificate), absl::ToInt64Seconds(until));
  X509_set_pubkey(certificate, key);
  X509_NAME* name = X509_get_subject_name(certificate);
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC,
                             reinterpret_cast<const unsigned char*>("localhost"), -1, -1, 0);
  X509_set_issuer_name(certificate, name);
  ASSERT_GT(X509_sign(certificate, key, EVP_sha256()), 0);
  FILE* file = fopen(path.c_str(), "w");
  ASSERT_NE(file, nullptr);
  PEM_write_X509(file, certificate);
  fclose(file);
  file = fopen(key_path.c_str(), "w");
  ASSERT_NE(file, nullptr);
  PEM_write_PrivateKey(file, key, passphrase == nullptr ? nullptr : EVP_aes_256_cbc(), nullptr, 0,
                       nullptr, const_cast<char*>(passphrase));
  fclose(file);
  chmod(key_path.c_str(), 0600);
  X509_free(certificate);
  EVP_PKEY_free(key);
}

// The client's end of TLS over a connected socket that blocks. A wait lasts a minute at most.
class TlsEnd {
 public:
  explicit TlsEnd(int fd, int version = 0)
      : context_(SSL_CTX_new(TLS_client_method()), SSL_CTX_free) {
    const timeval patience = {60, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof(patience));
    SSL_CTX_set_security_level(context_.get(),
                               0);  // of the server's, nothing is left to the client
    SSL_CTX_set_min_proto_version(context_.get(), version);
    SSL_CTX_set_max_proto_version(context_.get(), version);
    ssl_ = {SSL_new(context_.get()), SSL_free};
    SSL_set_fd(ssl_.get(), fd);
  }
  bool Handshake() {
    ERR_clear_error();
    return SSL_connect(ssl_.get()) == 1;
  }
  bool Send(std::string_view text) {
    ERR_clear_error();
    return text.empty() || SSL_write(ssl_.get(), text.data(), static_cast<int>(text.size())) ==
                               static_cast<int>(text.size());
  }
  // Waits for `size` bytes, or until the other end hangs up.
  std::string Receive(size_t size) {
    std::string text;
    while (text.size() < size) {
      char buffer[16384];
      ERR_clear_error();
      const int n = SSL_read(ssl_.get(), buffer,
                             static_cast<int>(std::min(sizeof(buffer), size - text.size())));
      if (n <= 0) break;
      text.append(buffer, static_cast<size_t>(n));
    }
    return text;
  }
  SSL* ssl() const { return ssl_.get(); }

 private:
  std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context_;
  std::unique_ptr<SSL, decltype(&SSL_free)> ssl_{nullptr, SSL_free};
};

}  // namespace myograde::server
