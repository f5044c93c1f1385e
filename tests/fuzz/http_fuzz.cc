// The bytes of one connection to the API's socket, for the server that the daemon uses, with
// handlers that treat requests like the API's. Each connection must end in time, and the server
// must answer the next one.
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/api/requests.h"
#include "server/http/http_server.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

constexpr absl::Duration kRequest = absl::Seconds(2);
constexpr int64_t kBody = 4096;

void Add(Router& router, const std::string& method, const std::string& pattern,
         std::function<void(const Request&, Response&)> serve, BodyRule body = {}) {
  router.Add({method, pattern, Action::kReadApi, std::move(serve), std::move(body)});
}

// `file` is what is exported.
void Install(Router& router, const std::string& file) {
  Add(router, "GET", "/v1/health", [](const Request&, Response& response) {
    response.SetContent("{\"state\":\"ready\"}\n", "application/json");
  });
  Add(router, "GET", "/v1/submissions", [](const Request& request, Response& response) {
    const auto filter = ParseFilter(request);
    response.status = filter.ok() ? 200 : 400;
    response.SetContent(std::string(filter.status().message()), "text/plain");
  });
  Add(router, "GET", R"(/v1/submissions/(\d{1,18}))", [](const Request& request, Response& response) {
    response.SetContent(std::to_string(ReadId(request)), "text/plain");
  });
  Add(router, "GET", "/v1/export", [file](const Request&, Response& response) {
    Require(response.SetFile(file, "application/json").ok(), "a file is sent");
  });
  Add(router, "POST", "/v1/submissions", [](const Request& request, Response& response) {
    const absl::StatusOr<std::string> body = request.body->Text();
    Require(body.ok() && std::ssize(*body) <= kBody, "a body is whole and within its limit");
    const absl::StatusOr<nlohmann::json> json = ParseJson(*body, "request");
    response.status = json.ok() && ParseSubmit(*json).ok() ? 201 : 400;
    response.SetContent("{}", "application/json");
  });
  // Large enough to be spooled to disk.
  Add(router, "POST", "/v1/artefacts",
      [](const Request& request, Response& response) {
        const int64_t size = request.body->size();
        const absl::StatusOr<std::string> text = request.body->Text();
        Require(text.ok() && std::ssize(*text) == size, "a body is as long as it says");
        response.SetContent(std::to_string(size), "text/plain");
      },
      {.most = 1 << 20, .upload = true, .types = {"application/x-tar"}});
}

class World {
 public:
  World() : server_({.workers = 2, .clients = 8, .request = kRequest, .upload = kRequest,
                     .idle = kRequest, .body_bytes = kBody}, folder_ / "") {
    Require(WriteFile(folder_ / "export", std::string(100'000, 'x')).ok(), "a file is written");
    Install(server_.router(), folder_ / "export");
    Require(server_.Start(path()).ok(), "a server starts");
  }

  // Everything sent in reply to `bytes`, after which the client has finished sending.
  std::string Talk(std::string_view bytes) const {
    const Fd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_un address = {};
    address.sun_family = AF_UNIX;
    const std::string path = this->path();
    std::memcpy(address.sun_path, path.data(), path.size());
    Require(connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0,
            "the server is there");
    while (!bytes.empty()) {
      const ssize_t n = send(fd.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0) break;  // it hung up
      bytes.remove_prefix(static_cast<size_t>(n));
    }
    shutdown(fd.get(), SHUT_WR);
    // A request has its timeout, and so does the end of an unfinished one.
    const absl::Duration deadline = SystemClock().Monotonic() + 3 * kRequest;
    std::string answer;
    char buffer[1 << 16];
    for (;;) {
      pollfd entry = {fd.get(), POLLIN, 0};
      const absl::Duration left = deadline - SystemClock().Monotonic();
      Require(left > absl::ZeroDuration(), "a connection ends in time");
      if (poll(&entry, 1, static_cast<int>(absl::ToInt64Milliseconds(left)) + 1) <= 0) continue;
      const ssize_t n = recv(fd.get(), buffer, sizeof(buffer), 0);
      if (n <= 0) return answer;
      answer.append(buffer, static_cast<size_t>(n));
      // A kept connection may make many requests, but each answer is bounded.
      Require(answer.size() < (64u << 20), "answers are bounded");
    }
  }

 private:
  std::string path() const { return folder_ / "s"; }

  const fuzz::Folder folder_;
  HttpServer server_;
};

}  // namespace

MYOGRADE_FUZZ_TARGET(http)(const uint8_t* data, size_t size) {
  static const World world;
  const std::string answer = world.Talk({reinterpret_cast<const char*>(data), size});
  Require(answer.empty() || answer.starts_with("HTTP/1.1 "), "an answer is one of HTTP");
  static int64_t round = 0;
  if (round++ % 64 == 0) {
    Require(world.Talk("GET /v1/health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
                    .starts_with("HTTP/1.1 200"),
            "the next client is served");
  }
  return 0;
}
