// What handlers answer, and its form on the connection (RFC 9112).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/http/request.h"

namespace myograde::server {

// What of a file is still to be sent.
struct FilePart {
  Fd fd;
  int64_t at = 0;    // bytes
  int64_t left = 0;  // bytes
};

// An answer that goes on after its first part: whatever `next` returns is sent, and `next` is called
// again `every` after that, until it returns nullopt or the time is over. It runs on a worker's
// thread, like a handler, and must own what it touches.
struct Stream {
  std::function<std::optional<std::string>()> next;
  absl::Duration every;
  absl::Duration began;
  absl::Duration until;
};

class Response {
 public:
  int status = 200;

  // Replaces one of that name. Content-Type, Content-Length and Connection are set by what follows.
  void SetHeader(const std::string& name, std::string value);

  // The answer is one of these: a text, a file, or a stream.
  void SetContent(std::string text, std::string_view type);
  // The whole file, in pieces that are read when those before are sent, so that it may be of any
  // size and no worker waits for the client. It stays open until then; its name may go.
  // NotFoundError: there is none.
  absl::Status SetFile(const std::string& path, const char* type);
  // What `next` returns, at once and then every so often (see Stream), for `time` at most; the
  // connection ends with it.
  void SetStream(const char* type, absl::Duration every, absl::Duration time,
                 std::function<std::optional<std::string>()> next);
  // JSON for its caller alone, that holds only for a moment.
  void SetJson(int http, std::string content);
  // Tells of an error in the form of README.md, in place of whatever was set before.
  void SetError(const ApiError& error);

  // Its head and its text as they are sent, which leaves only `file` and `stream`. `bodiless`: it is
  // to HEAD. `close`: nothing more is read on the connection.
  std::string TakeBytes(bool bodiless, bool close);

  std::string text;
  FilePart file;
  std::unique_ptr<Stream> stream;

 private:
  std::vector<std::pair<std::string, std::string>> headers_;
};

// An answer that tells of an error and that nothing more is read on the connection.
std::string RefusalBytes(const ApiError& error);
// Sends it as far as the socket takes it at once.
void SendRefusal(int socket, const ApiError& error);

}  // namespace myograde::server
