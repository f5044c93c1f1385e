#include "server/http/tls.h"

#include <absl/strings/str_cat.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"

namespace myograde::server {
namespace {

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
    return WrongFile(path, "the key has a passphrase, and nobody could type it; store it without");
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
  std::string warning = WarningOf(certificate, own, key);
  return std::shared_ptr<TlsContext>(new TlsContext(std::move(owner), std::move(warning)));
}

}  // namespace myograde::server
