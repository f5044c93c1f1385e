// A request as handlers see it, and its form, read strictly: where its head ends, how long its body
// is and how it is framed. What two readers could understand in two ways is refused, so that a proxy
// in front finds the same requests. No sockets and no clocks here.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

class Body;

// A refusal, as every client gets it.
struct ApiError {
  int http = 500;
  std::string code;     // a word of README.md's table
  std::string message;  // one sentence: what, where, and what to do
  int64_t retry_after_s = 1;  // told with 429 and 503
  std::string allow = "";     // the methods that the address has; told with 405
};

struct Request {
  std::string method;
  std::string path;                                // decoded, without the query
  std::multimap<std::string, std::string> params;  // of the query, decoded
  // By name in lower case, without Authorization.
  std::multimap<std::string, std::string> headers;
  std::string host;          // lower case, without a port; "" if there is none
  std::string content_type;  // lower case, without parameters; "" if there is none
  // The value of the header Authorization; nullopt: there is none.
  std::optional<std::string> authorization;
  bool keep_alive = true;
  bool expects_continue = false;
  bool chunked = false;
  int64_t length = 0;  // of the body; 0 if chunked
  // Whom a proxy has the request from: the last entry of X-Forwarded-For, which is the one that the
  // nearest proxy added; "" if there is none.
  std::string forwarded_for;

  // For a handler: `path` and the groups of its address's pattern, if that is none itself; and the body,
  // whole.
  std::vector<std::string> matches;
  Body* body = nullptr;

  bool has_body() const { return chunked || length > 0; }
  bool HasParam(const std::string& key) const { return params.contains(key); }
  // The first of that name; "" if there is none.
  std::string Param(const std::string& key) const;
};

// Text of an address with %XX undone, and '+' in a query; a '%' that begins no code stays.
std::string DecodeUrl(std::string_view text, bool query);
std::multimap<std::string, std::string> ParseQuery(std::string_view query);

// Takes one request out of a connection's bytes, by Boost.Beast, whatever pieces they come in.
class RequestParser {
 public:
  RequestParser();
  RequestParser& operator=(RequestParser&&) noexcept;
  ~RequestParser();

  // Takes the request's head off `bytes`, which are all that came since the last call used any up.
  // How many of them it used; `request` is filled in once has_head().
  size_t TakeHead(std::string_view bytes, Request& request);
  bool has_head() const;
  // After the head: its body may have `most` bytes.
  void BeginBody(const Request& request, int64_t most);
  // Appends to `body` what of `bytes` belongs there. How many of them it used; the others come again
  // with the next call.
  size_t TakeBody(std::string_view bytes, std::string& body);

  // Whether BeginBody was called.
  bool in_body() const { return in_body_; }
  // Whether the request is there as a whole.
  bool done() const;
  // Set once the bytes can't be a request, or not one that is taken. Nothing more may be given then.
  const std::optional<ApiError>& error() const { return error_; }
  int64_t size() const;  // of the body so far

 private:
  class Beast;

  void ScanHead(std::string_view bytes);

  std::unique_ptr<Beast> beast_;  // nullptr: nothing has come
  size_t scanned_ = 0;
  bool in_body_ = false;
  int64_t most_ = 0;
  std::optional<ApiError> error_;
};

}  // namespace myograde::server
