// A request's form, read strictly and before any handler sees it: where its head
// ends, how long its body is and how it is framed. What two readers could
// understand in two ways is refused, so that whoever reads it later finds one
// request with one length. No sockets and no clocks here.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

#include "server/api/api_error.h"

namespace myograde::server {

// Of a request's line and headers together, and of a chunked body's trailers.
inline constexpr size_t kMaxHeadBytes = 32 << 10;

struct RequestHead {
  std::string method;
  std::string path;          // without the query
  std::string host;          // lower case, without a port; "" if there is none
  std::string content_type;  // lower case, without parameters; "" if there is none
  // The value of the header Authorization; nullopt: there is none. It is not in `canonical`.
  std::optional<std::string> authorization;
  bool keep_alive = true;
  bool expects_continue = false;
  bool chunked = false;
  int64_t length = 0;  // of the body; 0 if chunked
  // Whom a proxy has the request from: the last entry of X-Forwarded-For, which is the one that the
  // nearest proxy added; "" if there is none.
  std::string forwarded_for;
  // The same request for the handlers, without the empty line at its end: HTTP/1.1, and
  // without the headers that are about this connection, who asks, the framing, or parts of an
  // answer.
  std::string canonical;

  bool has_body() const { return chunked || length > 0; }
};

// Finds the end of a head in bytes that come piece by piece.
class HeadScanner {
 public:
  // `bytes` are all that came so far, and are only added to between calls. The
  // head's length with its empty line; 0: there must come more. Empty lines before
  // the request's own are counted in.
  size_t Scan(std::string_view bytes);
  // Set once the bytes can't be a head, or not one that is taken.
  const std::optional<ApiError>& error() const { return error_; }

 private:
  size_t seen_ = 0;
  size_t begin_ = 0;  // of the request's line
  std::optional<ApiError> error_;
};

// Reads a whole head, as HeadScanner cut it off. False: `error` says what is wrong.
bool ParseRequestHead(std::string_view bytes, RequestHead& head, ApiError& error);

// Takes a body out of a connection's bytes, undoing chunks.
class BodyReader {
 public:
  // At most `most` bytes are taken.
  BodyReader(const RequestHead& head, int64_t most);

  // Appends to `body` what of `bytes` belongs there; returns how many bytes of
  // the connection that used up. Takes nothing once it is done or has failed.
  size_t Take(std::string_view bytes, std::string& body);

  bool done() const { return state_ == State::kDone; }
  const std::optional<ApiError>& error() const { return error_; }
  // Bytes of the body so far.
  int64_t size() const { return size_; }

 private:
  enum class State { kData, kSizeLine, kDataEnd, kTrailer, kDone, kFailed };

  void Fail(int http, const char* code, std::string message);
  // Takes one line with its end; nullopt: there must come more.
  std::optional<std::string> TakeLine(std::string_view bytes, size_t& used, size_t longest);
  void ReadSizeLine(const std::string& line);

  const bool chunked_;
  const int64_t most_;
  State state_;
  int64_t left_ = 0;     // of the body, or of the chunk
  int64_t size_ = 0;
  std::string line_;     // the beginning of one
  size_t trailers_ = 0;  // bytes
  std::optional<ApiError> error_;
};

// "Content Too Large" for 413; for every status that the API uses.
std::string_view HttpReason(int status);

// An answer that tells of an error and that nothing more is read on the connection.
std::string RefusalBytes(const ApiError& error);

}  // namespace myograde::server
