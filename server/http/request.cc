#include "server/http/request.h"

#include <algorithm>
#include <iterator>

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <boost/asio/buffer.hpp>
#include <boost/beast/http/basic_parser.hpp>
#include <boost/beast/http/error.hpp>

namespace myograde::server {
namespace {

namespace http = boost::beast::http;

// Of a request's line and headers together, and of what stands between two chunks of a body.
constexpr size_t kMaxHeadBytes = 32 << 10;
constexpr size_t kMaxTargetBytes = 8000;
constexpr size_t kMaxLineBytes = 8000;
constexpr size_t kMaxLines = 100;

ApiError Bad(std::string message) { return {400, "bad_request", std::move(message)}; }
ApiError TooLarge(int64_t most) {
  return {413, "too_large", absl::StrCat("the body is larger than ", most, " bytes")};
}

bool IsHexDigit(char c) { return absl::ascii_isxdigit(static_cast<unsigned char>(c)); }

std::string Lower(std::string_view text) {
  return absl::AsciiStrToLower(absl::string_view(text.data(), text.size()));
}

std::string_view Stripped(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

// The values of a header, of which a request may have several.
std::vector<std::string> ValuesOf(const Request& request, const char* name) {
  std::vector<std::string> values;
  const auto [begin, end] = request.headers.equal_range(name);
  std::transform(begin, end, std::back_inserter(values), [](const auto& header) { return header.second; });
  return values;
}

using Refusal = std::optional<ApiError>;

// Whether a Host header's value is a name or an address, and perhaps a port (RFC 9110, 7.2).
bool IsHost(std::string_view value) {
  const size_t bracket = value.starts_with('[') ? value.find(']') : 0;
  if (bracket == std::string_view::npos) return false;
  const size_t colon = value.find(':', bracket);
  const std::string_view port = colon == std::string_view::npos ? "" : value.substr(colon + 1);
  const std::string_view name = value.substr(0, colon);
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto in_name = [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
           std::string_view("-._~%!$&'()*+,;=").find(c) != std::string_view::npos;
  };
  const auto in_address = [](char c) {
    return absl::ascii_isxdigit(static_cast<unsigned char>(c)) || c == ':' || c == '.';
  };
  return std::all_of(port.begin(), port.end(), is_digit) &&
         (bracket == 0 ? std::all_of(name.begin(), name.end(), in_name)
                       : bracket + 1 == name.size() &&
                             std::all_of(name.begin() + 1, name.end() - 1, in_address));
}

// `authority`: of the request's line; "": it has none.
Refusal ReadHost(bool old_version, const std::string& authority, Request& request) {
  const std::vector<std::string> hosts = ValuesOf(request, "host");
  if (hosts.size() > 1 || (hosts.empty() && !old_version)) {
    return Bad("a request of HTTP/1.1 has the header Host exactly once");
  }
  if (hosts.empty() && authority.empty()) return std::nullopt;
  const std::string& value = authority.empty() ? hosts[0] : authority;
  if (!IsHost(value) || (!hosts.empty() && !IsHost(hosts[0]))) {
    return Bad("the header Host must be a name or an address, and perhaps a port");
  }
  const size_t end = value.starts_with('[') ? value.find(']') + 1 : value.find(':');
  request.host = Lower(std::string_view(value).substr(0, end));
  return std::nullopt;
}

Refusal ReadTarget(std::string_view target, Request& request, std::string& authority) {
  if (target.size() > kMaxTargetBytes) {
    return ApiError{414, "bad_request",
                    absl::StrCat("the address is longer than ", kMaxTargetBytes, " bytes")};
  }
  // The absolute form, which proxies use (RFC 9112, 3.2.2): what it names comes before the header Host.
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!target.starts_with(scheme)) continue;
    const size_t path = std::min(target.find_first_of("/?", scheme.size()), target.size());
    authority = target.substr(scheme.size(), path - scheme.size());
    target.remove_prefix(path);
  }
  if (target.empty() || target[0] != '/' ||
      std::any_of(target.begin(), target.end(), [](char c) { return c <= ' ' || c >= 0x7f; })) {
    return Bad("the request's address must begin with / and be in ASCII; write other characters as %XX");
  }
  const size_t path = std::min(target.find('?'), target.size());
  request.path = DecodeUrl(target.substr(0, path), /*query=*/false);
  request.params = ParseQuery(target.substr(std::min(path + 1, target.size())));
  return std::nullopt;
}

Refusal ReadFraming(Request& request) {
  const std::vector<std::string> encodings = ValuesOf(request, "transfer-encoding");
  const std::vector<std::string> lengths = ValuesOf(request, "content-length");
  if (encodings.size() > 1 || (encodings.size() == 1 && Lower(encodings[0]) != "chunked")) {
    return ApiError{501, "bad_request", "the only transfer encoding that this server takes is \"chunked\""};
  }
  if (lengths.size() + encodings.size() > 1) {
    return Bad("a request has one Content-Length or is chunked, not both");
  }
  request.chunked = !encodings.empty();
  if (!lengths.empty()) {
    // SimpleAtoi alone takes signs and spaces too.
    const bool digits = lengths[0].find_first_not_of("0123456789") == std::string::npos;
    if (!digits || lengths[0].size() > 18 || !absl::SimpleAtoi(lengths[0], &request.length)) {
      return Bad("Content-Length must be a number of bytes");
    }
  }
  const std::string& method = request.method;
  if (request.has_body() && (method == "GET" || method == "HEAD" || method == "DELETE")) {
    return Bad(absl::StrCat("a ", method, " has no body here; put what you ask for into the address"));
  }
  return std::nullopt;
}

// What the headers say besides the host and the framing.
Refusal ReadMeaning(bool old_version, Request& request) {
  for (const std::string& value : ValuesOf(request, "expect")) {
    if (Lower(value) != "100-continue") {
      return ApiError{417, "bad_request", "the only expectation that this server knows is \"100-continue\""};
    }
    request.expects_continue = !old_version && request.has_body();
  }
  for (const std::string& value : ValuesOf(request, "x-forwarded-for")) {
    request.forwarded_for = Stripped(std::string_view(value).substr(value.rfind(',') + 1));
  }
  const std::vector<std::string> authorizations = ValuesOf(request, "authorization");
  if (authorizations.size() > 1) return Bad("duplicate Authorization header");
  if (!authorizations.empty()) request.authorization = authorizations[0];
  request.headers.erase("authorization");
  const std::vector<std::string> types = ValuesOf(request, "content-type");
  if (types.size() > 1) return Bad("duplicate Content-Type header");
  if (!types.empty()) {
    request.content_type = Lower(Stripped(std::string_view(types[0]).substr(0, types[0].find(';'))));
  }
  for (const std::string& value : ValuesOf(request, "content-encoding")) {
    if (Lower(value) == "identity") continue;
    return ApiError{415, "bad_type", "encoded bodies are not supported; send it without "
                                     "Content-Encoding"};
  }
  return std::nullopt;
}

// What Beast found wrong with the head that `bytes` begin with.
ApiError HeadError(const boost::system::error_code& wrong, std::string_view bytes) {
  if (wrong == http::error::header_limit) {
    return {431, "too_large", absl::StrCat("a request's head has at most ", kMaxHeadBytes, " bytes")};
  }
  const std::string_view line = bytes.substr(0, bytes.find('\r'));
  if (wrong == http::error::bad_version && line.find(" HTTP/") != std::string_view::npos &&
      !line.ends_with(" HTTP/1.1") && !line.ends_with(" HTTP/1.0")) {
    return {505, "bad_request", "this server speaks HTTP/1.1 and HTTP/1.0"};
  }
  if (wrong == http::error::bad_method || wrong == http::error::bad_target ||
      wrong == http::error::bad_version) {
    return Bad("the request line is malformed: it must be a method, an address and HTTP/1.1, with one "
               "space in between");
  }
  if (wrong == http::error::bad_content_length || wrong == http::error::multiple_content_length ||
      wrong == http::error::bad_transfer_encoding) {
    return Bad("a request says how long its body is once: by one Content-Length, a number of bytes, or "
               "as chunked");
  }
  return Bad("a header's line must be a name, a colon right behind it, and a value");
}

}  // namespace

// Beast knows the grammar; what this server takes of it is decided here.
class RequestParser::Beast : public http::basic_parser<true> {
 public:
  Beast() {
    header_limit(kMaxHeadBytes);
    body_limit(boost::none);
  }

  Request request;
  std::string* body = nullptr;  // where what comes of it goes
  int64_t size = 0;             // of it so far
  Refusal refusal;

 private:
  using Code = boost::beast::error_code;
  using View = boost::beast::string_view;

  void RefuseIf(Refusal why, Code& code) {
    if (!why.has_value()) return;
    refusal = std::move(why);
    code = make_error_code(boost::system::errc::invalid_argument);
  }

  void on_request_impl(http::verb, View method, View target, int version, Code& code) override {
    request.method.assign(method.data(), method.size());
    old_version_ = version == 10;
    if (method.size() > 16) return RefuseIf(Bad("the request's method is not one of HTTP"), code);
    RefuseIf(ReadTarget({target.data(), target.size()}, request, authority_), code);
  }

  void on_response_impl(int, View, int, Code&) override {}

  void on_field_impl(http::field, View name, View value, Code& code) override {
    if (is_header_done()) return;  // a trailer
    if (name.size() + value.size() > kMaxLineBytes || request.headers.size() >= kMaxLines) {
      return RefuseIf(ApiError{431, "too_large",
                               absl::StrCat("a request has at most ", kMaxLines, " headers, of ",
                                            kMaxLineBytes, " bytes each")}, code);
    }
    request.headers.emplace(Lower({name.data(), name.size()}), std::string(value.data(), value.size()));
  }

  void on_header_impl(Code& code) override {
    Refusal why = ReadHost(old_version_, authority_, request);
    if (!why.has_value()) why = ReadFraming(request);
    if (!why.has_value()) why = ReadMeaning(old_version_, request);
    request.keep_alive = !old_version_ && keep_alive();  // our answers say HTTP/1.1
    RefuseIf(std::move(why), code);
  }

  void on_body_init_impl(const boost::optional<std::uint64_t>&, Code&) override {}
  size_t on_body_impl(View bytes, Code&) override { return Append(bytes); }
  void on_chunk_header_impl(std::uint64_t, View, Code&) override {}
  size_t on_chunk_body_impl(std::uint64_t, View bytes, Code&) override { return Append(bytes); }
  void on_finish_impl(Code&) override {}

  size_t Append(View bytes) {
    body->append(bytes.data(), bytes.size());
    size += static_cast<int64_t>(bytes.size());
    return bytes.size();
  }

  bool old_version_ = false;
  std::string authority_;  // of the request's line; "": it has none
};

std::string Request::Param(const std::string& key) const {
  const auto it = params.find(key);
  return it == params.end() ? "" : it->second;
}

std::string DecodeUrl(std::string_view text, bool query) {
  std::string decoded;
  for (size_t i = 0; i < text.size(); ++i) {
    uint32_t code = 0;
    const bool coded = text[i] == '%' && i + 2 < text.size() && IsHexDigit(text[i + 1]) &&
                       IsHexDigit(text[i + 2]) &&
                       absl::SimpleHexAtoi(std::string(text.substr(i + 1, 2)), &code);
    decoded += coded ? static_cast<char>(code) : query && text[i] == '+' ? ' ' : text[i];
    if (coded) i += 2;
  }
  return decoded;
}

std::multimap<std::string, std::string> ParseQuery(std::string_view query) {
  std::multimap<std::string, std::string> params;
  for (const absl::string_view part :
       absl::StrSplit(absl::string_view(query.data(), query.size()), '&', absl::SkipEmpty())) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(part, absl::MaxSplits('=', 1));
    params.emplace(DecodeUrl(pair.first, /*query=*/true), DecodeUrl(pair.second, /*query=*/true));
  }
  return params;
}

RequestParser::RequestParser() = default;
RequestParser& RequestParser::operator=(RequestParser&&) noexcept = default;
RequestParser::~RequestParser() = default;

bool RequestParser::has_head() const {
  return !error_ && beast_ != nullptr && beast_->is_header_done();
}
bool RequestParser::done() const { return beast_ != nullptr && beast_->is_done(); }
int64_t RequestParser::size() const { return beast_ == nullptr ? 0 : beast_->size; }

// Beast waits for a head's end, which need not come of bytes that can't be one.
void RequestParser::ScanHead(std::string_view bytes) {
  for (; scanned_ < bytes.size(); ++scanned_) {
    const char c = bytes[scanned_];
    if (c == '\n' && (scanned_ == 1 || (scanned_ > 1 && bytes[scanned_ - 2] == '\n'))) return;
    const bool after_return = scanned_ > 0 && bytes[scanned_ - 1] == '\r';
    if ((c == '\n') != after_return) {
      error_ = Bad("every line of a request's head must end in CR LF, and neither may occur "
                   "elsewhere");
    } else if ((static_cast<unsigned char>(c) < ' ' && c != '\r' && c != '\n' && c != '\t') || c == 0x7f) {
      error_ = Bad("a request's head has no control characters");
    } else if ((c == ' ' || c == '\t') && scanned_ > 0 && bytes[scanned_ - 1] == '\n') {
      error_ = Bad("a header has one line");
    }
    if (error_) return;
  }
}

size_t RequestParser::TakeHead(std::string_view bytes, Request& request) {
  size_t empty = 0;
  if (beast_ == nullptr) {
    // Empty lines before a request are an end of an earlier one.
    while (bytes.substr(empty).starts_with("\r\n")) empty += 2;
    bytes.remove_prefix(empty);
    if (bytes.empty() || bytes == "\r") return empty;
    beast_ = std::make_unique<Beast>();
  }
  ScanHead(bytes);
  if (error_) return empty;
  boost::beast::error_code wrong;
  const size_t used = beast_->put(boost::asio::buffer(bytes.data(), bytes.size()), wrong);
  if (!wrong) {
    request = std::move(beast_->request);
  } else if (wrong != http::error::need_more) {
    error_ = beast_->refusal ? *beast_->refusal : HeadError(wrong, bytes);
  }
  scanned_ -= std::min(scanned_, used);
  return empty + used;
}

void RequestParser::BeginBody(const Request& request, int64_t most) {
  in_body_ = true;
  beast_->body_limit(static_cast<uint64_t>(most));
  most_ = most;
  if (request.length > most) error_ = TooLarge(most);
}

size_t RequestParser::TakeBody(std::string_view bytes, std::string& body) {
  beast_->body = &body;
  size_t used = 0;
  while (!error_ && !done() && used < bytes.size()) {
    boost::beast::error_code wrong;
    used += beast_->put(boost::asio::buffer(bytes.data() + used, bytes.size() - used), wrong);
    if (wrong == http::error::body_limit) {
      error_ = TooLarge(most_);
    } else if (wrong == http::error::need_more) {
      if (bytes.size() - used > kMaxHeadBytes) error_ = Bad("a line between two chunks of the body is too long");
      break;
    } else if (wrong) {
      error_ = Bad("the body's chunks are malformed");
    }
  }
  return used;
}

}  // namespace myograde::server
