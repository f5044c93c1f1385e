#include "server/cli/client/connect.h"

#include <absl/strings/str_cat.h>
#include <grp.h>
#include <openssl/x509.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <limits>

namespace myograde::server {
namespace {

std::string UserName(uid_t uid) {
  const passwd* user = ::getpwuid(uid);
  return user != nullptr ? user->pw_name : absl::StrCat("uid ", uid);
}

std::string OwnerOf(const std::string& path) {
  struct stat info = {};
  return ::stat(path.c_str(), &info) == 0 ? UserName(info.st_uid) : "another user";
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
    const std::string user = UserName(::geteuid());
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

absl::Status CheckCaFile(const std::string& file) {
  if (file.empty() || ::access(file.c_str(), R_OK) == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(file, ": the file of authorities to trust can't be read (", std::strerror(errno),
                   "); correct --ca-file, MYOGRADE_CA_FILE, or the login"));
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
    case X509_V_OK:  // libcurl's own check of the host
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

std::string NetworkTrouble(const ServerChoice& choice, const HttpAnswer& answer) {
  using Failure = HttpAnswer::Failure;
  const std::string server = choice.address.Text();
  switch (answer.failure) {
    case Failure::kUnreachable:
      return absl::StrCat("no server can be reached at ", server,
                          "; check the address and the network, or ask its organiser");
    case Failure::kCaFile:
      return absl::StrCat(choice.ca_file,
                          ": holds no certificates in PEM; correct --ca-file, "
                          "MYOGRADE_CA_FILE, or the login");
    case Failure::kTls:
      return absl::StrCat(
          "no TLS connection to ", server,
          " could be made: it may speak plain HTTP "
          "or an old TLS there, or have too many connections; check the address, or "
          "try again in a minute");
    case Failure::kCertificate:
      return CertificateTrouble(choice, answer.certificate);
    default:
      return absl::StrCat("the server at ", server, " did not answer (", answer.problem,
                          "); try again, or ask its organiser");
  }
}

}  // namespace

absl::StatusOr<HttpRequest> RequestTo(const ServerChoice& choice, const std::string& path,
                                      absl::Duration silence) {
  HttpRequest request = {.url = absl::StrCat("http://myograde", path),
                         .silence = silence,
                         .most_text = std::numeric_limits<size_t>::max()};
  absl::Status usable;
  if (choice.address.network()) {
    request.url = choice.address.Text() + path;
    request.ca_file = choice.ca_file;
    usable = CheckCaFile(choice.ca_file);
  } else {
    request.unix_socket = choice.address.socket;
    usable = CheckSocket(choice.address.socket);
  }
  if (!usable.ok()) return usable;
  if (!choice.token.empty()) request.headers = {"Authorization: Bearer " + choice.token};
  return request;
}

absl::Status NoAnswer(const ServerChoice& choice, const HttpAnswer& answer) {
  const std::string where = choice.address.Text();
  if (choice.address.network()) {
    return absl::UnavailableError(absl::StrCat(
        NetworkTrouble(choice, answer),
        choice.by_login ? "; \"myograde logout\" returns to the daemon of this host" : ""));
  }
  if (answer.failure == HttpAnswer::Failure::kUnreachable) {
    return absl::UnavailableError(
        absl::StrCat("no daemon listens on ", where, "; start one with \"myograde serve\""));
  }
  return absl::UnavailableError(absl::StrCat("the daemon on ", where, " did not answer (",
                                             answer.problem, "); look at its log, or try again"));
}

}  // namespace myograde::server
