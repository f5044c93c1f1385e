#include "server/cli/client/client.h"

#include <httplib.h>
#include <openssl/rand.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The daemon answers a request in 30 s and an upload in 900 s (server.json); a
// little more here, so that its own sentence arrives.
constexpr time_t kConnectSeconds = 10;
constexpr time_t kAnswerSeconds = 60;
constexpr time_t kUploadSeconds = 960;
constexpr size_t kRefusalBytes = 65536;
// A daemon that was restarted in between is there again.
constexpr absl::Duration kBeforeRetry = absl::Seconds(1);

void Prepare(httplib::ClientImpl& http, time_t answer_seconds) {
  http.set_address_family(AF_UNIX);
  http.set_default_headers({{"Host", "myograde"}});
  http.set_connection_timeout(kConnectSeconds);
  http.set_read_timeout(answer_seconds);
  http.set_write_timeout(kAnswerSeconds);
}

absl::StatusOr<Json> AnswerOf(const httplib::Result& result, const std::string& socket) {
  if (!result) {
    if (result.error() == httplib::Error::Connection) {
      return absl::UnavailableError(
          absl::StrCat("no daemon listens on ", socket, "; start one with \"myograde serve\""));
    }
    return absl::UnavailableError(absl::StrCat("the daemon on ", socket, " did not answer (",
                                               httplib::to_string(result.error()),
                                               "); look at its log, or try again"));
  }
  Json json = Json::parse(result->body, nullptr, /*allow_exceptions=*/false);
  const bool good = result->status >= 200 && result->status < 300;
  if (good && json.is_object()) return json;
  std::string message = absl::StrCat("the daemon answered with HTTP status ", result->status,
                                     " and nothing that can be read");
  if (json.is_object() && json.contains("error") && json["error"].is_object() &&
      json["error"].contains("message") && json["error"]["message"].is_string()) {
    message = json["error"]["message"].get<std::string>();
  }
  const bool refused = result->status >= 400 && result->status < 500 && result->status != 429;
  return refused ? absl::InvalidArgumentError(message) : absl::InternalError(message);
}

// Invalid UTF-8 from the command line is sent as U+FFFD; dump would throw otherwise.
std::string TextOf(const Json& body) {
  return body.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// Of a request, which no other one has.
absl::StatusOr<std::string> NewKey() {
  std::string bytes(16, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()),
                 static_cast<int>(bytes.size())) != 1) {
    return absl::InternalError("this host gives no random bytes");
  }
  return absl::BytesToHexString(bytes);
}

std::string OwnerOf(const std::string& path) {
  struct stat info = {};
  if (::stat(path.c_str(), &info) != 0) return "another user";
  const passwd* user = ::getpwuid(info.st_uid);
  return user != nullptr ? user->pw_name : absl::StrCat("uid ", info.st_uid);
}

// What stands in the way of a socket that may not be reached, and what to do.
std::string ClosedSocket(const std::string& socket) {
  std::string closed = socket;  // the topmost that lets this user no further
  for (std::filesystem::path folder = std::filesystem::absolute(socket).parent_path();
       !folder.empty(); folder = folder.parent_path()) {
    if (::access(folder.c_str(), X_OK) != 0) closed = folder.string();
    if (folder == folder.root_path()) break;
  }
  const std::string owner = OwnerOf(closed);
  return absl::StrCat("this user may not talk to the daemon on ", socket, ": ", closed,
                      " is open to ", owner, " alone; run this as ", owner,
                      ", or ask the organiser to start the daemon with --socket in a folder that "
                      "others may enter, and give that here with --socket");
}

}  // namespace

absl::Status Client::CheckSocket() const {
  if (socket_.size() >= sizeof(sockaddr_un::sun_path)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the socket's path ", socket_, " is longer than ", sizeof(sockaddr_un::sun_path) - 1,
        " bytes, the most that a Unix socket can have; give a shorter one with --socket"));
  }
  if (::access(socket_.c_str(), R_OK | W_OK) == 0) return absl::OkStatus();
  if (errno == EACCES) return absl::UnavailableError(ClosedSocket(socket_));
  return absl::UnavailableError(absl::StrCat(
      "no daemon can be reached: there is no socket ", socket_,
      "; start one with \"myograde serve\", or say where it is with --data or --socket"));
}

absl::StatusOr<Json> Client::Get(const std::string& path) const {
  if (absl::Status status = CheckSocket(); !status.ok()) return status;
  httplib::ClientImpl http(socket_);
  Prepare(http, kAnswerSeconds);
  return AnswerOf(http.Get(path), socket_);
}

absl::StatusOr<Json> Client::Post(const std::string& path, const Json& body) const {
  if (absl::Status status = CheckSocket(); !status.ok()) return status;
  httplib::ClientImpl http(socket_);
  Prepare(http, kAnswerSeconds);
  return AnswerOf(http.Post(path, TextOf(body), "application/json"), socket_);
}

absl::StatusOr<Json> Client::PostOnce(const std::string& path, const Json& body) const {
  absl::StatusOr<std::string> key = NewKey();
  if (!key.ok()) return key.status();
  const httplib::Headers headers = {{"Idempotency-Key", *std::move(key)}};
  const std::string text = TextOf(body);
  for (bool again = false;; again = true) {
    if (absl::Status status = CheckSocket(); !status.ok()) return status;
    httplib::ClientImpl http(socket_);
    Prepare(http, kAnswerSeconds);
    const httplib::Result result = http.Post(path, headers, text, "application/json");
    const bool lost = !result && result.error() != httplib::Error::Connection;
    if (!lost || again) return AnswerOf(result, socket_);
    absl::SleepFor(kBeforeRetry);
  }
}

absl::StatusOr<Json> Client::Upload(const std::string& path, const std::string& file,
                                    const std::function<void(int64_t, int64_t)>& progress,
                                    const std::string& type) const {
  if (absl::Status status = CheckSocket(); !status.ok()) return status;
  std::ifstream input(file, std::ios::binary);
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(file, error);
  if (!input || error) return absl::InternalError(absl::StrCat(file, ": can't be read"));
  httplib::ClientImpl http(socket_);
  Prepare(http, kUploadSeconds);
  std::vector<char> buffer(256 << 10);
  const auto provide = [&](size_t offset, size_t length, httplib::DataSink& sink) {
    const size_t want = std::min(length, buffer.size());
    input.seekg(static_cast<std::streamoff>(offset));
    if (!input.read(buffer.data(), static_cast<std::streamsize>(want))) return false;
    const bool sent = sink.write(buffer.data(), want);
    progress(static_cast<int64_t>(offset + want), static_cast<int64_t>(size));
    return sent;
  };
  const httplib::Result result =
      http.Post(path, static_cast<size_t>(size), provide, type);
  if (!result && result.error() != httplib::Error::Connection) {
    return absl::UnavailableError(absl::StrCat(
        "the daemon on ", socket_, " hung up in the middle of an upload of ", size, " bytes (",
        httplib::to_string(result.error()),
        "): it may be larger than archive_bytes in server.json allows, or have taken longer than "
        "upload_s; the daemon's log says more"));
  }
  return AnswerOf(result, socket_);
}

absl::StatusOr<int64_t> Client::Download(
    const std::string& path, const std::function<bool(const char*, size_t)>& sink,
    const std::function<void(int64_t, int64_t)>& progress) const {
  if (absl::Status status = CheckSocket(); !status.ok()) return status;
  httplib::ClientImpl http(socket_);
  Prepare(http, kUploadSeconds);
  int64_t done = 0;
  int64_t total = 0;
  int status = 0;
  bool kept = true;
  std::string refusal;
  httplib::Result result = http.Get(
      path,
      [&](const httplib::Response& response) {
        status = response.status;
        total = static_cast<int64_t>(response.get_header_value<uint64_t>("Content-Length"));
        return true;
      },
      [&](const char* data, size_t size) {
        if (status != 200) {
          refusal.append(data, std::min(size, kRefusalBytes - std::min(refusal.size(),
                                                                       kRefusalBytes)));
          return true;
        }
        done += static_cast<int64_t>(size);
        progress(done, total);
        return kept = sink(data, size);
      });
  if (result && status == 200) return done;
  if (!kept) return absl::InternalError("what the daemon sends can't be written");
  if (result) result->body = refusal;
  const absl::StatusOr<Json> answer = AnswerOf(result, socket_);
  if (!answer.ok()) return answer.status();
  return absl::InternalError("the daemon's answer is not what was asked for");
}

std::string QueryValue(const std::string& value) {
  return httplib::detail::encode_query_param(value);
}

}  // namespace myograde::server
