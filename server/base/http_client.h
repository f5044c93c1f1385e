// Requests to HTTP servers, by libcurl: over TCP, TLS (1.2 or later, always verified) or a Unix
// socket. No redirect is followed and no proxy is used.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/time/time.h>

namespace myograde::server {

// What it refers to must outlive the request.
struct HttpRequest {
  std::string url = {};
  std::string unix_socket = {};              // path of the socket to connect to; "": the URL's host
  std::string ca_file = {};                  // PEM; "": whom this host or SSL_CERT_FILE trusts
  std::vector<std::string> headers = {};     // "Name: value"
  std::optional<std::string_view> body = {}; // of a POST; without it and `body_file` it is a GET
  int body_file = -1;                        // in place of `body`: a file, from its beginning on
  std::string type = "application/json";     // of the body
  absl::Duration connect = absl::Seconds(10);  // longest time until there is a connection
  absl::Duration time = absl::InfiniteDuration();     // longest time of the whole exchange
  absl::Duration silence = absl::InfiniteDuration();  // longest time with under 512 bytes a second
  size_t most_text = 64 << 10;               // bytes of the answer's text
  // Takes the content of an answer of status 200, piece by piece, in place of the text. False: stop.
  std::function<bool(std::string_view)> sink = {};
  // Hears how many bytes of the body's file, or of the content for `sink`, are done, of how many.
  std::function<void(int64_t done, int64_t total)> progress = {};
  // True: give up, at the latest 0.2 s after.
  std::function<bool()> stop = {};
};

struct HttpAnswer {
  enum class Failure {
    kNone,
    kUnreachable,  // nobody is connected to
    kTls,          // no TLS is spoken there
    kCertificate,  // not trusted, or for another host
    kCaFile,       // holds no certificates
    kTimeout,
    kStopped,
    kNotTaken,     // by `sink`, or longer than `most_text`
    kOther,        // the connection was lost, as far as `problem` says
  };
  Failure failure = Failure::kNone;
  int status = 0;      // 0: no answer came; set with a failure, what follows its head is not whole
  std::string text;
  std::string problem; // the failure, in libcurl's words
  long certificate = 0;  // OpenSSL's finding (X509_V_ERR_…); 0 with kCertificate: for another host
  bool sent = false;     // the request, or a part of it, may have arrived
};

// Keeps its connection for the next request. For one thread at a time.
class HttpClient {
 public:
  HttpClient();
  HttpAnswer Ask(const HttpRequest& request);

 private:
  // libcurl's; null if there is no memory.
  using Handle = std::unique_ptr<void, void (*)(void*)>;
  Handle multi_;  // has the connections
  Handle easy_;
};

// `value` as it may stand in a query.
std::string QueryValue(const std::string& value);

}  // namespace myograde::server
