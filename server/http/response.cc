#include "server/http/response.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <algorithm>
#include <string_view>

#include <absl/strings/str_cat.h>
#include <boost/beast/http/status.hpp>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"

namespace myograde::server {

void Response::SetHeader(const std::string& name, std::string value) {
  // No value of a client's can end a line.
  std::replace_if(value.begin(), value.end(), [](char c) { return c == '\r' || c == '\n'; }, ' ');
  std::erase_if(headers_, [&](const auto& header) { return header.first == name; });
  headers_.emplace_back(name, std::move(value));
}

void Response::SetContent(std::string content, std::string_view type) {
  text = std::move(content);
  SetHeader("Content-Type", std::string(type));
}

absl::Status Response::SetFile(const std::string& path, const char* type) {
  Fd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info;
  if (!fd.valid() || fstat(fd.get(), &info) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be read"));
  }
  SetHeader("Content-Type", type);
  file = {std::move(fd), 0, info.st_size};
  return absl::OkStatus();
}

void Response::SetStream(const char* type, absl::Duration every, absl::Duration time,
                         std::function<std::optional<std::string>()> next) {
  SetHeader("Content-Type", type);
  const absl::Duration now = SystemClock().Monotonic();
  stream = std::make_unique<Stream>(
      Stream{std::move(next), every, /*began=*/now, /*until=*/now + time});
}

void Response::SetJson(int http, std::string content) {
  status = http;
  SetHeader("Cache-Control", "no-store");
  SetHeader("X-Content-Type-Options", "nosniff");
  SetContent(std::move(content), "application/json");
}

void Response::SetError(const ApiError& error) {
  *this = Response();
  if (error.http == 429 || error.http == 503) {
    SetHeader("Retry-After", absl::StrCat(error.retry_after_s));
  }
  if (error.http == 401) SetHeader("WWW-Authenticate", "Bearer");
  if (!error.allow.empty()) SetHeader("Allow", error.allow);
  const nlohmann::json body = {{"error", {{"code", error.code}, {"message", error.message}}}};
  SetJson(error.http, CanonicalJson(body) + "\n");
}

std::string Response::TakeBytes(bool bodiless, bool close) {
  namespace http = boost::beast::http;
  std::string head = absl::StrCat(
      "HTTP/1.1 ", status, " ", std::string(http::obsolete_reason(http::status(status))), "\r\n");
  for (const auto& [name, value] : headers_) absl::StrAppend(&head, name, ": ", value, "\r\n");
  // Without a length a stream lasts as long as its connection; these two have none (RFC 9110, 8.6).
  const bool sized = stream == nullptr && status != 204 && status != 304;
  if (sized) absl::StrAppend(&head, "Content-Length: ", std::ssize(text) + file.left, "\r\n");
  if (close || stream != nullptr) head += "Connection: close\r\n";
  head += "\r\n";
  if (bodiless) {
    file = FilePart();
    stream = nullptr;
    return head;
  }
  std::string bytes = std::move(text);
  bytes.insert(0, head);
  return bytes;
}

std::string RefusalBytes(const ApiError& error) {
  Response response;
  response.SetError(error);
  return response.TakeBytes(/*bodiless=*/false, /*close=*/true);
}

void SendRefusal(int socket, const ApiError& error) {
  const std::string text = RefusalBytes(error);
  [[maybe_unused]] const ssize_t n =
      ::send(socket, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

}  // namespace myograde::server
