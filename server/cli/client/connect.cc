#include "server/cli/client/connect.h"

#include <absl/strings/str_cat.h>
#include <grp.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <pwd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "server/base/ip_address.h"

namespace myograde::server {
namespace {

constexpr std::time_t kConnectSeconds = 10;
constexpr std::time_t kWriteSeconds = 60;

std::string OwnerOf(const std::string& path) {
  struct stat info = {};
  if (::stat(path.c_str(), &info) != 0) return "another user";
  const passwd* user = ::getpwuid(info.st_uid);
  return user != nullptr ? user->pw_name : absl::StrCat("uid ", info.st_uid);
}

std::string OwnName() {
  const passwd* user = ::getpwuid(::geteuid());
  return user != nullptr ? user->pw_name : absl::StrCat("uid ", ::geteuid());
}

// The group, other than root's, whose members `rights` let use `path`; "" if there is none.
std::string GroupThatMay(const std::string& path, mode_t rights) {
  struct stat info = {};
  if (::stat(path.c_str(), &info) != 0 || (info.st_mode & rights) != rights || info.st_gid == 0) {
    return "";
  }
  const group* found = ::getgrgid(info.st_gid);
  return found != nullptr ? found->gr_name : "";
}

// By /etc/group, which a session that is open reads no more.
bool IsMember(const std::string& user, const std::string& name) {
  const group* found = ::getgrnam(name.c_str());
  if (found == nullptr) return false;
  for (char** member = found->gr_mem; *member != nullptr; ++member) {
    if (user == *member) return true;
  }
  return false;
}

// What stands in the way of a socket that may not be reached, and what to do.
std::string ClosedSocket(const std::string& socket) {
  std::string closed = socket;  // the topmost that lets this user no further
  for (std::filesystem::path folder = std::filesystem::absolute(socket).parent_path();
       !folder.empty(); folder = folder.parent_path()) {
    if (::access(folder.c_str(), X_OK) != 0) closed = folder.string();
    if (folder == folder.root_path()) break;
  }
  if (const std::string group = GroupThatMay(closed, closed == socket ? S_IRGRP | S_IWGRP : S_IXGRP);
      !group.empty()) {
    const std::string user = OwnName();
    return absl::StrCat("this user may not talk to the daemon on ", socket, ": ", closed,
                        " is open to the group ", group, ", and ", user,
                        IsMember(user, group)
                            ? absl::StrCat(" joined it after this session began; log in anew, or "
                                           "type: newgrp ", group)
                            : absl::StrCat(" is not in it; ask the administrator to type: adduser ",
                                           user, " ", group, ", then log in anew"));
  }
  const std::string owner = OwnerOf(closed);
  return absl::StrCat("this user may not talk to the daemon on ", socket, ": ", closed,
                      " is open to ", owner, " alone; run this as ", owner,
                      ", or ask the organiser to start the daemon with --socket in a folder that "
                      "others may enter, and give that here with --socket");
}

absl::Status CheckSocket(const std::string& socket) {
  if (socket.size() >= sizeof(sockaddr_un::sun_path)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the socket's path ", socket, " is longer than ", sizeof(sockaddr_un::sun_path) - 1,
        " bytes, the most that a Unix socket can have; give a shorter one with --socket"));
  }
  if (::access(socket.c_str(), R_OK | W_OK) == 0) return absl::OkStatus();
  if (errno == EACCES) return absl::UnavailableError(ClosedSocket(socket));
  return absl::UnavailableError(absl::StrCat(
      "no daemon can be reached: there is no socket ", socket,
      "; start one with \"myograde serve\", or say where it is with --data, --socket or --server"));
}

// On top of cpp-httplib's own checks, OpenSSL's of the host, which are those of RFC 6125.
absl::StatusOr<std::unique_ptr<httplib::ClientImpl>> SecureClient(const ServerChoice& choice) {
  if (!choice.ca_file.empty() && ::access(choice.ca_file.c_str(), R_OK) != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(choice.ca_file, ": the file of authorities to trust can't be read (",
                     std::strerror(errno), "); correct --ca-file, MYOGRADE_CA_FILE, or the login"));
  }
  const std::string& host = choice.address.host;
  auto http = std::make_unique<httplib::SSLClient>(host, choice.address.port);
  SSL_CTX* context = http->ssl_context();
  if (!http->is_valid() || context == nullptr) {
    return absl::InternalError("OpenSSL can't make a client on this host");
  }
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  X509_VERIFY_PARAM* checks = SSL_CTX_get0_param(context);
  X509_VERIFY_PARAM_set_hostflags(checks, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
  const bool numeric = IpAddress::Parse(host).has_value();
  const int set = numeric ? X509_VERIFY_PARAM_set1_ip_asc(checks, host.c_str())
                          : X509_VERIFY_PARAM_set1_host(checks, host.c_str(), host.size());
  if (set != 1) return absl::InternalError("OpenSSL does not take the server's name");
  http->enable_server_certificate_verification(true);
  if (!choice.ca_file.empty()) http->set_ca_cert_path(choice.ca_file);
  return http;
}

// What is wrong with the server's certificate; `code` is OpenSSL's.
std::string CertificateTrouble(const ServerChoice& choice, long code) {
  const std::string server = choice.address.Text();
  const std::string beginning = absl::StrCat("the certificate of ", server, " ");
  switch (code) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return beginning +
             "has expired; its organiser has to renew it (or this host's clock is wrong)";
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return beginning + "is not valid yet; check this host's clock";
    case X509_V_OK:  // cpp-httplib's own check of the host
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      return absl::StrCat(beginning, "is not for ", choice.address.host,
                          "; write the address with the name that the certificate has, which its "
                          "organiser can tell");
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
      if (!choice.ca_file.empty()) {
        return absl::StrCat(beginning, "is not signed by an authority in ", choice.ca_file,
                            "; ask the organiser for the right file");
      }
      return beginning +
             "is signed by nobody whom this host trusts; if the lab has an authority of "
             "its own, give its certificate with --ca-file";
    default:
      return absl::StrCat(beginning, "can't be trusted (", X509_verify_cert_error_string(code),
                          ")");
  }
}

std::string NetworkTrouble(const ServerChoice& choice, const httplib::ClientImpl& http,
                           httplib::Error error) {
  const std::string server = choice.address.Text();
  switch (error) {
    case httplib::Error::Connection:
    case httplib::Error::ConnectionTimeout:
      return absl::StrCat("no server can be reached at ", server,
                          "; check the address and the network, or ask its organiser");
    case httplib::Error::SSLLoadingCerts:
      return absl::StrCat(choice.ca_file,
                          ": holds no certificates in PEM; correct --ca-file, "
                          "MYOGRADE_CA_FILE, or the login");
    case httplib::Error::SSLConnection:
      return absl::StrCat(
          "no TLS connection to ", server,
          " could be made: it may speak plain HTTP "
          "or an old TLS there, or have too many connections; check the address, or "
          "try again in a minute");
    case httplib::Error::SSLServerVerification: {
      const auto* secure = dynamic_cast<const httplib::SSLClient*>(&http);
      return CertificateTrouble(
          choice, secure == nullptr ? X509_V_OK : secure->get_openssl_verify_result());
    }
    default:
      return absl::StrCat("the server at ", server, " did not answer (", httplib::to_string(error),
                          "); try again, or ask its organiser");
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<httplib::ClientImpl>> Connect(const ServerChoice& choice,
                                                             std::time_t answer_seconds) {
  httplib::Headers headers;
  std::unique_ptr<httplib::ClientImpl> http;
  if (!choice.address.network()) {
    if (absl::Status status = CheckSocket(choice.address.socket); !status.ok()) return status;
    http = std::make_unique<httplib::ClientImpl>(choice.address.socket);
    http->set_address_family(AF_UNIX);
    headers.emplace("Host", "myograde");
  } else {
    if (choice.address.kind == ServerAddress::Kind::kHttps) {
      absl::StatusOr<std::unique_ptr<httplib::ClientImpl>> secure = SecureClient(choice);
      if (!secure.ok()) return secure.status();
      http = *std::move(secure);
    } else {
      http = std::make_unique<httplib::ClientImpl>(choice.address.host, choice.address.port);
    }
    const std::string url = choice.address.Text();
    headers.emplace("Host", url.substr(url.find("://") + 3));
  }
  if (!choice.token.empty()) headers.emplace("Authorization", "Bearer " + choice.token);
  http->set_default_headers(std::move(headers));
  http->set_follow_location(false);
  http->set_connection_timeout(kConnectSeconds);
  http->set_read_timeout(answer_seconds);
  http->set_write_timeout(kWriteSeconds);
  return http;
}

absl::Status NoAnswer(const ServerChoice& choice, const httplib::ClientImpl& http,
                      httplib::Error error) {
  const std::string where = choice.address.Text();
  if (choice.address.network()) {
    return absl::UnavailableError(absl::StrCat(
        NetworkTrouble(choice, http, error),
        choice.by_login ? "; \"myograde logout\" returns to the daemon of this host" : ""));
  }
  if (error == httplib::Error::Connection) {
    return absl::UnavailableError(
        absl::StrCat("no daemon listens on ", where, "; start one with \"myograde serve\""));
  }
  return absl::UnavailableError(absl::StrCat("the daemon on ", where, " did not answer (",
                                             httplib::to_string(error),
                                             "); look at its log, or try again"));
}

}  // namespace myograde::server
