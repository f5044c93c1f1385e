#include "server/api/http_request.h"

#include <algorithm>
#include <array>
#include <vector>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <absl/strings/str_split.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxTargetBytes = 8000;
// cpp-httplib takes a line of 8192 bytes and no longer one.
constexpr size_t kMaxLineBytes = 8000;
constexpr size_t kMaxLines = 100;
constexpr size_t kMaxChunkLine = 256;

// Headers that the handlers must not see: they are about this connection or its framing, hold a
// secret, or ask for parts of an answer, and every answer is whole.
constexpr std::array kOwn = {"authorization", "connection", "content-length", "expect", "keep-alive",
                             "myograde-accept-encoding", "proxy-connection", "range", "te", "trailer",
                             "transfer-encoding", "upgrade"};

ApiError Bad(std::string message) { return {400, "bad_request", std::move(message)}; }

bool IsTokenChar(char c) {
  return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
         std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool IsToken(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), IsTokenChar);
}

std::string Lower(std::string_view text) {
  return absl::AsciiStrToLower(absl::string_view(text.data(), text.size()));
}

std::string_view Stripped(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

// A number of decimal digits; nothing else that number readers take.
std::optional<int64_t> ParseLength(std::string_view text) {
  if (text.empty() || text.size() > 18) return std::nullopt;
  int64_t value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    value = value * 10 + (c - '0');
  }
  return value;
}

// What the headers say together; each kind is looked at when all are read.
struct Headers {
  std::vector<std::string> lengths;
  std::vector<std::string> encodings;  // of the transfer
  std::vector<std::string> connection;
  std::vector<std::string> expect;
  std::vector<std::string> types;
  std::vector<std::string> content_encodings;
  std::vector<std::string> authorizations;
  std::vector<std::string> hosts;
};

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
bool ReadHost(const Headers& headers, bool old_version, const std::string& authority,
              RequestHead& head, ApiError& error) {
  if (headers.hosts.size() > 1 || (headers.hosts.empty() && !old_version)) {
    error = Bad("a request of HTTP/1.1 has the header Host exactly once");
    return false;
  }
  if (headers.hosts.empty() && authority.empty()) return true;
  const std::string& value = authority.empty() ? headers.hosts[0] : authority;
  if (!IsHost(value) || (!headers.hosts.empty() && !IsHost(headers.hosts[0]))) {
    error = Bad("the header Host must be a name or an address, and perhaps a port");
    return false;
  }
  const size_t end = value.starts_with('[') ? value.find(']') + 1 : value.find(':');
  head.host = Lower(std::string_view(value).substr(0, end));
  return true;
}

bool ReadRequestLine(std::string_view line, RequestHead& head, bool& old_version,
                     std::string& authority, ApiError& error) {
  const size_t first = line.find(' ');
  const size_t second = first == std::string_view::npos ? first : line.find(' ', first + 1);
  if (second == std::string_view::npos || line.find(' ', second + 1) != std::string_view::npos) {
    error = Bad("the first line is no request: it must be a method, an address and HTTP/1.1, with "
                "one space in between");
    return false;
  }
  head.method = line.substr(0, first);
  std::string_view target = line.substr(first + 1, second - first - 1);
  const std::string_view version = line.substr(second + 1);
  if (!IsToken(head.method) || head.method.size() > 16) {
    error = Bad("the request's method is no word of HTTP");
    return false;
  }
  if (target.size() > kMaxTargetBytes) {
    error = {414, "bad_request",
             absl::StrCat("the address is longer than ", kMaxTargetBytes, " bytes")};
    return false;
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
    error = Bad("the request's address must begin with / and be in ASCII; write other characters "
                "as %XX");
    return false;
  }
  if (version != "HTTP/1.1" && version != "HTTP/1.0") {
    error = {505, "bad_request", "this server speaks HTTP/1.1 and HTTP/1.0"};
    return false;
  }
  old_version = version == "HTTP/1.0";
  head.path = target.substr(0, target.find('?'));
  // RFC 3986 allows a question mark in a query; cpp-httplib takes it only as %3F.
  const size_t query = std::min(target.find('?'), target.size() - 1) + 1;
  head.canonical = absl::StrCat(head.method, " ", std::string(target.substr(0, query)),
                                absl::StrReplaceAll(std::string(target.substr(query)), {{"?", "%3F"}}),
                                " HTTP/1.1\r\n");
  return true;
}

bool ReadHeader(std::string_view line, Headers& headers, RequestHead& head, ApiError& error) {
  const size_t colon = line.find(':');
  if (colon == std::string_view::npos || !IsToken(line.substr(0, colon))) {
    error = Bad("a header's line must be a name, a colon right behind it, and a value");
    return false;
  }
  if (line.size() > kMaxLineBytes) {
    error = {431, "too_large", absl::StrCat("a header is longer than ", kMaxLineBytes, " bytes")};
    return false;
  }
  const std::string name = Lower(line.substr(0, colon));
  const std::string value(Stripped(line.substr(colon + 1)));
  if (name == "content-length") headers.lengths.push_back(value);
  if (name == "transfer-encoding") headers.encodings.push_back(Lower(value));
  if (name == "connection") headers.connection.push_back(Lower(value));
  if (name == "expect") headers.expect.push_back(Lower(value));
  if (name == "content-type") headers.types.push_back(Lower(value));
  if (name == "authorization") headers.authorizations.push_back(value);
  if (name == "content-encoding") headers.content_encodings.push_back(Lower(value));
  if (name == "host") headers.hosts.push_back(value);
  if (name == "x-forwarded-for") {
    head.forwarded_for = Stripped(std::string_view(value).substr(value.rfind(',') + 1));
  }
  if (std::find(kOwn.begin(), kOwn.end(), name) == kOwn.end()) {
    // cpp-httplib would compress each answer anew, for up to a hundred times what the answer costs.
    absl::StrAppend(&head.canonical, name == "accept-encoding" ? "Myograde-" : "",
                    absl::string_view(line.data(), line.size()), "\r\n");
  }
  return true;
}

bool ReadFraming(const Headers& headers, RequestHead& head, ApiError& error) {
  if (!headers.encodings.empty()) {
    if (headers.encodings.size() > 1 || headers.encodings[0] != "chunked") {
      error = {501, "bad_request", "of transfer encodings this server takes \"chunked\" alone"};
      return false;
    }
    if (!headers.lengths.empty()) {
      error = Bad("a request has Content-Length or is chunked, not both");
      return false;
    }
    head.chunked = true;
  }
  if (headers.lengths.size() > 1) {
    error = Bad("Content-Length is there twice");
    return false;
  }
  if (!headers.lengths.empty()) {
    const std::optional<int64_t> length = ParseLength(headers.lengths[0]);
    if (!length.has_value()) {
      error = Bad("Content-Length must be a number of bytes");
      return false;
    }
    head.length = *length;
  }
  if (head.has_body() &&
      (head.method == "GET" || head.method == "HEAD" || head.method == "DELETE")) {
    error = Bad(absl::StrCat("a ", head.method, " has no body here; put what you ask for into the "
                             "address"));
    return false;
  }
  return true;
}

}  // namespace

size_t HeadScanner::Scan(std::string_view bytes) {
  for (; !error_ && seen_ < bytes.size(); ++seen_) {
    const char c = bytes[seen_];
    const bool after_return = seen_ > begin_ && bytes[seen_ - 1] == '\r';
    if ((c == '\n') != after_return) {
      error_ =
          Bad("every line of a request's head ends in CR and LF, and neither stands elsewhere");
    } else if (c == '\n' && seen_ == begin_ + 1) {
      begin_ = seen_ + 1;  // an empty line before the request, as an end of an earlier one
    } else if (c == '\n' && seen_ >= begin_ + 3 && bytes[seen_ - 2] == '\n') {
      return ++seen_;
    } else if (c != '\r' && c != '\n' && c != '\t' &&
               (static_cast<unsigned char>(c) < ' ' || c == 0x7f)) {
      error_ = Bad("a request's head has no control characters");
    }
  }
  if (!error_ && seen_ >= kMaxHeadBytes) {
    error_ = {431, "too_large",
              absl::StrCat("a request's head has at most ", kMaxHeadBytes, " bytes")};
  }
  return 0;
}

bool ParseRequestHead(std::string_view bytes, RequestHead& head, ApiError& error) {
  std::vector<std::string_view> lines;
  while (!bytes.empty()) {
    const size_t end = bytes.find("\r\n");
    if (end == std::string_view::npos) {
      error = Bad("a line of the request's head has no end");
      return false;
    }
    if (end > 0) lines.push_back(bytes.substr(0, end));
    bytes.remove_prefix(end + 2);
  }
  if (lines.empty() || lines.size() > kMaxLines) {
    error = {431, "too_large", absl::StrCat("a request's head has 1 to ", kMaxLines, " lines")};
    return false;
  }
  bool old_version = false;
  std::string authority;
  if (!ReadRequestLine(lines[0], head, old_version, authority, error)) return false;
  Headers headers;
  for (size_t i = 1; i < lines.size(); ++i) {
    if (!ReadHeader(lines[i], headers, head, error)) return false;
  }
  if (!ReadHost(headers, old_version, authority, head, error) || !ReadFraming(headers, head, error)) {
    return false;
  }
  head.keep_alive = !old_version;
  for (const std::string& value : headers.connection) {
    for (const absl::string_view word : absl::StrSplit(value, ',')) {
      const absl::string_view option = absl::StripAsciiWhitespace(word);
      if (option == "close") head.keep_alive = false;
      if (option == "keep-alive" && headers.connection.size() == 1 && old_version) {
        head.keep_alive = true;
      }
    }
  }
  for (const std::string& value : headers.expect) {
    if (value != "100-continue") {
      error = {417, "bad_request", "of expectations this server knows \"100-continue\" alone"};
      return false;
    }
    head.expects_continue = !old_version && head.has_body();
  }
  if (headers.authorizations.size() > 1) {
    error = Bad("Authorization is there twice");
    return false;
  }
  if (!headers.authorizations.empty()) head.authorization = headers.authorizations[0];
  if (headers.types.size() > 1) {
    error = Bad("Content-Type is there twice");
    return false;
  }
  if (!headers.types.empty()) {
    const std::string& type = headers.types[0];
    head.content_type = Stripped(std::string_view(type).substr(0, type.find(';')));
  }
  for (const std::string& value : headers.content_encodings) {
    if (value == "identity") continue;
    error = {415, "bad_type", "a body is taken as it is: send it without Content-Encoding"};
    return false;
  }
  return true;
}

BodyReader::BodyReader(const RequestHead& head, int64_t most)
    : chunked_(head.chunked), most_(most), state_(chunked_ ? State::kSizeLine : State::kData) {
  if (chunked_) return;
  left_ = head.length;
  if (left_ == 0) state_ = State::kDone;
  if (left_ > most_) {
    Fail(413, "too_large", absl::StrCat("the body is larger than ", most_, " bytes"));
  }
}

void BodyReader::Fail(int http, const char* code, std::string message) {
  state_ = State::kFailed;
  error_ = ApiError{http, code, std::move(message)};
}

std::optional<std::string> BodyReader::TakeLine(std::string_view bytes, size_t& used,
                                                size_t longest) {
  const size_t end = bytes.find('\n');
  const size_t size = end == std::string_view::npos ? bytes.size() : end + 1;
  if (line_.size() + size > longest) {
    Fail(400, "bad_request", "a line between the chunks of the body is too long");
    return std::nullopt;
  }
  line_.append(bytes.substr(0, size));
  used += size;
  if (end == std::string_view::npos) return std::nullopt;
  std::string line = std::move(line_);
  line_.clear();
  if (line.size() < 2 || line[line.size() - 2] != '\r') {
    Fail(400, "bad_request", "a line between the chunks of the body does not end in CR and LF");
    return std::nullopt;
  }
  line.resize(line.size() - 2);
  return line;
}

void BodyReader::ReadSizeLine(const std::string& line) {
  const std::string digits(Stripped(std::string_view(line).substr(0, line.find(';'))));
  uint64_t size = 0;
  const bool good =
      !digits.empty() && digits.size() <= 15 &&
      std::all_of(digits.begin(), digits.end(),
                  [](char c) { return absl::ascii_isxdigit(static_cast<unsigned char>(c)); }) &&
      absl::SimpleHexAtoi(digits, &size);
  if (!good) return Fail(400, "bad_request", "a chunk of the body has no size");
  left_ = static_cast<int64_t>(size);
  if (left_ > most_ - size_) {
    return Fail(413, "too_large", absl::StrCat("the body is larger than ", most_, " bytes"));
  }
  state_ = left_ == 0 ? State::kTrailer : State::kData;
}

size_t BodyReader::Take(std::string_view bytes, std::string& body) {
  size_t used = 0;
  while (used < bytes.size() && state_ != State::kDone && state_ != State::kFailed) {
    const std::string_view rest = bytes.substr(used);
    if (state_ == State::kData) {
      const auto size = static_cast<size_t>(
          std::min<int64_t>(left_, static_cast<int64_t>(rest.size())));
      body.append(rest.substr(0, size));
      used += size;
      size_ += static_cast<int64_t>(size);
      left_ -= static_cast<int64_t>(size);
      if (left_ == 0) state_ = chunked_ ? State::kDataEnd : State::kDone;
      continue;
    }
    const std::optional<std::string> line =
        TakeLine(rest, used, state_ == State::kTrailer ? kMaxLineBytes : kMaxChunkLine);
    if (!line.has_value()) continue;
    if (state_ == State::kSizeLine) {
      ReadSizeLine(*line);
    } else if (state_ == State::kDataEnd) {
      state_ = State::kSizeLine;
      if (!line->empty()) Fail(400, "bad_request", "a chunk of the body is longer than its size");
    } else if (line->empty()) {
      state_ = State::kDone;
    } else if ((trailers_ += line->size()) > kMaxHeadBytes) {
      Fail(431, "too_large", "the lines behind the body are too long");
    }
  }
  return used;
}

std::string_view HttpReason(int status) {
  switch (status) {
    case 400: return "Bad Request";
    case 401: return "Unauthorized";
    case 403: return "Forbidden";
    case 404: return "Not Found";
    case 405: return "Method Not Allowed";
    case 408: return "Request Timeout";
    case 410: return "Gone";
    case 413: return "Content Too Large";
    case 414: return "URI Too Long";
    case 415: return "Unsupported Media Type";
    case 417: return "Expectation Failed";
    case 421: return "Misdirected Request";
    case 429: return "Too Many Requests";
    case 431: return "Request Header Fields Too Large";
    case 501: return "Not Implemented";
    case 503: return "Service Unavailable";
    case 504: return "Gateway Timeout";
    case 505: return "HTTP Version Not Supported";
    default: return "Internal Server Error";
  }
}

std::string RefusalBytes(const ApiError& error) {
  const std::string body =
      CanonicalJson({{"error", {{"code", error.code}, {"message", error.message}}}}) + "\n";
  const std::string_view reason = HttpReason(error.http);
  return absl::StrCat("HTTP/1.1 ", error.http, " ", absl::string_view(reason.data(), reason.size()),
                      "\r\nConnection: close\r\nContent-Type: application/json\r\nContent-Length: ",
                      body.size(),
                      error.http == 429 || error.http == 503
                          ? absl::StrCat("\r\nRetry-After: ", error.retry_after_s)
                          : "",
                      error.http == 401 ? "\r\nWWW-Authenticate: Bearer" : "",
                      error.allow.empty() ? "" : absl::StrCat("\r\nAllow: ", error.allow), "\r\n\r\n",
                      body);
}

}  // namespace myograde::server
