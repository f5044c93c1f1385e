#include "server/cli/client/server_address.h"

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include <algorithm>
#include <optional>

#include "server/base/ip_address.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr int kHttpsPort = 443;
constexpr int kHttpPort = 80;
constexpr size_t kMaxHost = 253;

int UsualPort(ServerAddress::Kind kind) {
  return kind == ServerAddress::Kind::kHttps ? kHttpsPort : kHttpPort;
}

bool IsHostName(const std::string& host) {
  return !host.empty() && host.size() <= kMaxHost && host.front() != '-' && host.front() != '.' &&
         std::all_of(host.begin(), host.end(), [](unsigned char c) {
           return absl::ascii_isalnum(c) || c == '-' || c == '.';
         });
}

bool IsThisHost(const std::string& host) {
  if (host == "localhost") return true;
  const std::optional<IpAddress> address = IpAddress::Parse(host);
  return address.has_value() && address->IsLoopback();
}

// Host and port of what stands behind "https://". False: it is no such thing.
bool ReadAuthority(std::string text, ServerAddress& address) {
  if (text.ends_with('/')) text.pop_back();
  address.port = UsualPort(address.kind);
  const size_t bracket = text.rfind(']');
  const size_t colon = text.find(':', bracket == std::string::npos ? 0 : bracket);
  if (colon != std::string::npos) {
    const std::string port = text.substr(colon + 1);
    const bool digits = !port.empty() && port.size() <= 5 &&
                        port.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || !absl::SimpleAtoi(port, &address.port)) return false;
    if (address.port < 1 || address.port > 65535) return false;
    text.resize(colon);
  }
  if (text.starts_with('[')) {
    if (!text.ends_with(']')) return false;
    address.host = text.substr(1, text.size() - 2);
    return address.host.find(':') != std::string::npos &&
           IpAddress::Parse(address.host).has_value();
  }
  address.host = absl::AsciiStrToLower(text);
  return IsHostName(address.host);
}

}  // namespace

std::string ServerAddress::Text() const {
  if (!network()) return socket;
  const std::optional<IpAddress> numeric = IpAddress::Parse(host);
  std::string text = absl::StrCat(kind == Kind::kHttps ? "https://" : "http://",
                                  numeric.has_value() ? numeric->UrlHost() : host);
  if (port != UsualPort(kind)) absl::StrAppend(&text, ":", port);
  return text;
}

absl::StatusOr<ServerAddress> ParseServer(const std::string& text, const std::string& what) {
  ServerAddress address;
  if (text.starts_with("unix:") && text.size() > 5) {
    address.socket = text.substr(5);
    return address;
  }
  const size_t scheme = text.find("://");
  if (scheme == std::string::npos && text.find('/') != std::string::npos) {
    address.socket = text;
    return address;
  }
  if (text.find('@') != std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": an address has no user and no password in it; \"myograde login\" takes a token"));
  }
  const std::string word =
      absl::AsciiStrToLower(text.substr(0, scheme == std::string::npos ? 0 : scheme));
  address.kind = word == "https" ? ServerAddress::Kind::kHttps : ServerAddress::Kind::kHttp;
  const bool good =
      (word == "https" || word == "http") && ReadAuthority(text.substr(scheme + 3), address);
  if (!good) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": \"", CutText(Harmless(text), 80),
        "\" is no server's address: write https://HOST:PORT, or the path of a daemon's socket"));
  }
  if (address.kind == ServerAddress::Kind::kHttp && !IsThisHost(address.host)) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": ", address.Text(),
        " is without TLS, so that anybody on the way could read and "
        "change everything; write https://, or reach this host itself as http://127.0.0.1"));
  }
  return address;
}

}  // namespace myograde::server
