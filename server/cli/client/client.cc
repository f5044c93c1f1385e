#include "server/cli/client/client.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <utility>

#include <absl/strings/cord.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/base/secret.h"
#include "server/cli/client/connect.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The daemon answers a request in 30 s and an upload in 900 s (server.json); a
// little more here, so that its own sentence arrives.
constexpr absl::Duration kAnswer = absl::Seconds(60);
constexpr absl::Duration kUpload = absl::Seconds(960);
// A daemon that was restarted in between is there again.
constexpr absl::Duration kBeforeRetry = absl::Seconds(1);
constexpr char kCodeKey[] = "myograde/answered-code";

absl::StatusOr<HttpRequest> MakeRequest(const absl::StatusOr<ServerChoice>& choice,
                                        const std::string& path,
                                        absl::Duration silence = kAnswer) {
  if (!choice.ok()) return choice.status();
  return RequestTo(*choice, path, silence);
}

absl::StatusOr<Json> JsonOf(const HttpAnswer& answer, const ServerChoice& choice) {
  if (answer.failure != HttpAnswer::Failure::kNone) return NoAnswer(choice, answer);
  if (answer.status >= 300 && answer.status < 400) {
    return absl::InternalError(absl::StrCat(
        choice.address.Text(),
        " redirects requests, and redirections are not followed, as a token is for one server; give "
        "the daemon's own address"));
  }
  Json json = Json::parse(answer.text, nullptr, /*allow_exceptions=*/false);
  const bool good = answer.status >= 200 && answer.status < 300;
  if (good && json.is_object()) return json;
  std::string message = absl::StrCat("the daemon answered with HTTP status ", answer.status,
                                     " and nothing that can be read");
  if (json.is_object() && json.contains("error") && json["error"].is_object() &&
      json["error"].contains("message") && json["error"]["message"].is_string()) {
    message = Harmless(json["error"]["message"].get<std::string>());
  }
  const bool refused = answer.status >= 400 && answer.status < 500 && answer.status != 429;
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
bool IsLost(const HttpAnswer& answer) {
  return answer.failure != HttpAnswer::Failure::kNone && answer.sent;
}

// Of a request, which no other one has.
absl::StatusOr<std::string> NewKey() {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(16));
  return absl::BytesToHexString(bytes);
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
    ASSIGN_OR_RETURN(const HttpRequest request, MakeRequest(choice, path));
    const absl::StatusOr<Json> own = JsonOf(HttpClient().Ask(request), *choice);
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
  ASSIGN_OR_RETURN(HttpRequest request, MakeRequest(choice_, path));
  const std::string text = TextOf(body);
  request.body = text;
  return JsonOf(HttpClient().Ask(request), *choice_);
}

absl::StatusOr<Json> Client::PostOnce(const std::string& path, const Json& body) const {
  ASSIGN_OR_RETURN(const std::string key, NewKey());
  const std::string text = TextOf(body);
  for (bool again = false;; again = true) {
    ASSIGN_OR_RETURN(HttpRequest request, MakeRequest(choice_, path));
    request.body = text;
    request.headers.push_back("Idempotency-Key: " + key);
    const HttpAnswer answer = HttpClient().Ask(request);
    if (again || !IsLost(answer)) return JsonOf(answer, *choice_);
    absl::SleepFor(kBeforeRetry);
  }
}

absl::StatusOr<Json> Client::Upload(const std::string& path, const std::string& file,
                                    const std::function<void(int64_t, int64_t)>& progress,
                                    const std::string& type) const {
  const Fd input(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info = {};
  if (!input.valid() || ::fstat(input.get(), &info) != 0) {
    return absl::InternalError(absl::StrCat(file, ": can't be read"));
  }
  ASSIGN_OR_RETURN(HttpRequest request, MakeRequest(choice_, path, kUpload));
  request.body_file = input.get();
  request.type = type;
  request.progress = progress;
  const HttpAnswer answer = HttpClient().Ask(request);
  if (IsLost(answer)) {
    return absl::UnavailableError(absl::StrCat(
        "the daemon on ", choice_->address.Text(), " hung up in the middle of an upload of ",
        info.st_size, " bytes (", answer.problem,
        "): it may be larger than archive_bytes in server.json allows, or have taken longer than "
        "upload_s; the daemon's log says more"));
  }
  return JsonOf(answer, *choice_);
}

absl::StatusOr<int64_t> Client::Download(
    const std::string& path, const std::function<bool(const char*, size_t)>& sink,
    const std::function<void(int64_t, int64_t)>& progress) const {
  ASSIGN_OR_RETURN(HttpRequest request, MakeRequest(choice_, path, kUpload));
  int64_t done = 0;
  request.progress = progress;
  request.sink = [&](std::string_view piece) {
    done += std::ssize(piece);
    return sink(piece.data(), piece.size());
  };
  const HttpAnswer answer = HttpClient().Ask(request);
  const bool whole = answer.failure == HttpAnswer::Failure::kNone;
  if (whole && answer.status == 200) return done;
  if (answer.failure == HttpAnswer::Failure::kNotTaken) {
    return absl::InternalError("what the daemon sends can't be written");
  }
  RETURN_IF_ERROR(JsonOf(answer, *choice_).status());
  return absl::InternalError("the daemon's answer is not what was asked for");
}

}  // namespace myograde::server
