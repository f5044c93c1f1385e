#include "server/cli/client/client.h"

#include <httplib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <utility>
#include <vector>

#include <absl/strings/cord.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "server/base/random_bytes.h"
#include "server/cli/client/connect.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The daemon answers a request in 30 s and an upload in 900 s (server.json); a
// little more here, so that its own sentence arrives.
constexpr time_t kAnswerSeconds = 60;
constexpr time_t kUploadSeconds = 960;
constexpr size_t kRefusalBytes = 65536;
// A daemon that was restarted in between is there again.
constexpr absl::Duration kBeforeRetry = absl::Seconds(1);
constexpr char kCodeKey[] = "myograde/answered-code";

using Http = std::unique_ptr<httplib::ClientImpl>;

absl::StatusOr<Http> Open(const absl::StatusOr<ServerChoice>& choice, time_t answer_seconds) {
  if (!choice.ok()) return choice.status();
  return Connect(*choice, answer_seconds);
}

absl::StatusOr<Json> AnswerOf(const httplib::Result& result, const ServerChoice& choice,
                              const httplib::ClientImpl& http) {
  if (!result) return NoAnswer(choice, http, result.error());
  if (result->status >= 300 && result->status < 400) {
    return absl::InternalError(absl::StrCat(
        choice.address.Text(),
        " redirects requests, and redirections are not followed, as a token is for one server; give "
        "the daemon's own address"));
  }
  Json json = Json::parse(result->body, nullptr, /*allow_exceptions=*/false);
  const bool good = result->status >= 200 && result->status < 300;
  if (good && json.is_object()) return json;
  std::string message = absl::StrCat("the daemon answered with HTTP status ", result->status,
                                     " and nothing that can be read");
  if (json.is_object() && json.contains("error") && json["error"].is_object() &&
      json["error"].contains("message") && json["error"]["message"].is_string()) {
    message = Harmless(json["error"]["message"].get<std::string>());
  }
  const bool refused = result->status >= 400 && result->status < 500 && result->status != 429;
  absl::Status status =
      refused ? absl::InvalidArgumentError(message) : absl::InternalError(message);
  if (json.is_object() && json.contains("error") && json["error"].is_object() &&
      json["error"].contains("code") && json["error"]["code"].is_string()) {
    status.SetPayload(kCodeKey, absl::Cord(json["error"]["code"].get<std::string>()));
  }
  return status;
}

// Invalid UTF-8 from the command line is sent as U+FFFD; dump would throw otherwise.
std::string TextOf(const Json& body) {
  return body.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// Whether the request may have arrived though there is no answer.
bool IsLost(const httplib::Result& result) {
  return !result && (result.error() == httplib::Error::Read ||
                     result.error() == httplib::Error::Write);
}

// Of a request, which no other one has.
absl::StatusOr<std::string> NewKey() {
  const absl::StatusOr<std::string> bytes = RandomBytes(16);
  if (!bytes.ok()) return bytes.status();
  return absl::BytesToHexString(*bytes);
}

}  // namespace

std::string AnsweredCode(const absl::Status& status) {
  return std::string(status.GetPayload(kCodeKey).value_or(absl::Cord()));
}

Client::Client(std::string socket) : choice_(ServerChoice()) {
  choice_->address.socket = std::move(socket);
}

Client::Client(absl::StatusOr<ServerChoice> choice) : choice_(std::move(choice)) {}

absl::StatusOr<Json> Client::Get(const std::string& path) const {
  absl::StatusOr<ServerChoice> choice = choice_;
  absl::StatusOr<Json> answer = absl::UnknownError("");
  for (bool again = false;; again = true) {
    const absl::StatusOr<Http> http = Open(choice, kAnswerSeconds);
    if (!http.ok()) return http.status();
    const absl::StatusOr<Json> own = AnswerOf((*http)->Get(path), *choice, **http);
    if (!again) answer = own;
    if (again && own.ok()) {
      PrintToErrors(absl::StrCat("myograde: note: ", std::string(answer.status().message()),
                                 ". This is what everybody sees; \"myograde login\" takes a new token, "
                                 "\"myograde logout\" forgets this one."));
      return own;
    }
    // A token that is not valid any more should not hide what is public; who one is, is about the token.
    if (again || AnsweredCode(answer.status()) != "bad_token" || choice->token.empty() ||
        path == "/v1/whoami") {
      return answer;
    }
    choice->token.clear();
  }
}

absl::StatusOr<Json> Client::Post(const std::string& path, const Json& body) const {
  const absl::StatusOr<Http> http = Open(choice_, kAnswerSeconds);
  if (!http.ok()) return http.status();
  return AnswerOf((*http)->Post(path, TextOf(body), "application/json"), *choice_, **http);
}

absl::StatusOr<Json> Client::PostOnce(const std::string& path, const Json& body) const {
  absl::StatusOr<std::string> key = NewKey();
  if (!key.ok()) return key.status();
  const httplib::Headers headers = {{"Idempotency-Key", *std::move(key)}};
  const std::string text = TextOf(body);
  for (bool again = false;; again = true) {
    const absl::StatusOr<Http> http = Open(choice_, kAnswerSeconds);
    if (!http.ok()) return http.status();
    const httplib::Result result = (*http)->Post(path, headers, text, "application/json");
    if (again || !IsLost(result)) return AnswerOf(result, *choice_, **http);
    absl::SleepFor(kBeforeRetry);
  }
}

absl::StatusOr<Json> Client::Upload(const std::string& path, const std::string& file,
                                    const std::function<void(int64_t, int64_t)>& progress,
                                    const std::string& type) const {
  std::ifstream input(file, std::ios::binary);
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(file, error);
  if (!input || error) return absl::InternalError(absl::StrCat(file, ": can't be read"));
  const absl::StatusOr<Http> http = Open(choice_, kUploadSeconds);
  if (!http.ok()) return http.status();
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
      (*http)->Post(path, static_cast<size_t>(size), provide, type);
  if (IsLost(result)) {
    return absl::UnavailableError(absl::StrCat(
        "the daemon on ", choice_->address.Text(), " hung up in the middle of an upload of ", size,
        " bytes (",
        httplib::to_string(result.error()),
        "): it may be larger than archive_bytes in server.json allows, or have taken longer than "
        "upload_s; the daemon's log says more"));
  }
  return AnswerOf(result, *choice_, **http);
}

absl::StatusOr<int64_t> Client::Download(
    const std::string& path, const std::function<bool(const char*, size_t)>& sink,
    const std::function<void(int64_t, int64_t)>& progress) const {
  const absl::StatusOr<Http> http = Open(choice_, kUploadSeconds);
  if (!http.ok()) return http.status();
  int64_t done = 0;
  int64_t total = 0;
  int status = 0;
  bool kept = true;
  std::string refusal;
  httplib::Result result = (*http)->Get(
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
  const absl::StatusOr<Json> answer = AnswerOf(result, *choice_, **http);
  if (!answer.ok()) return answer.status();
  return absl::InternalError("the daemon's answer is not what was asked for");
}

std::string QueryValue(const std::string& value) {
  return httplib::detail::encode_query_param(value);
}

}  // namespace myograde::server
