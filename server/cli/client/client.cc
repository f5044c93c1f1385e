#include "server/cli/client/client.h"

#include <absl/strings/cord.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/base/secret.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/client/connect.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

// After a long wait the end need not be noticed at once, and each poll takes processor time from
// the policies that are graded.
constexpr absl::Duration kShortestPoll = absl::Milliseconds(250);
constexpr absl::Duration kLongestPoll = absl::Seconds(1);
constexpr int kPollsInAWait = 20;
constexpr absl::Duration kPatience = absl::Seconds(30);

std::string NoteOf(const Json& status) {
  const Json waiting = status.value("waiting", Json());
  if (status.value("state", "") != "queued") return status.value("state", "");
  return waiting.is_string() ? "queued: " + waiting.get<std::string>() : "queued";
}

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
  const Json error = json.is_object() ? json.value("error", Json()) : Json();
  std::string message = Harmless(TextAt(error, "message"));
  if (message.empty()) {
    message = absl::StrCat("the daemon answered with HTTP status ", answer.status,
                           " and nothing that can be read");
  }
  const bool refused = answer.status >= 400 && answer.status < 500 && answer.status != 429;
  absl::Status status =
      refused ? absl::InvalidArgumentError(message) : absl::InternalError(message);
  if (const std::string code = TextAt(error, "code"); !code.empty()) {
    status.SetPayload(kCodeKey, absl::Cord(code));
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

void AddRows(const Json& page, const std::string& key, Json& all) {
  const Json rows = page.value(key, Json::array());
  if (rows.is_array()) all[key].insert(all[key].end(), rows.begin(), rows.end());
}

}  // namespace

bool IsFinalState(const std::string& state) { return state != "queued" && state != "running"; }

int ExitOfState(const std::string& state) {
  if (state == "done") return kDone;
  return state == "grader_error" ? kTrouble : kNoScore;
}

absl::StatusOr<Json> Follow(const Client& client, const std::string& path,
                            const std::string& what) {
  return FollowUntil(client, path, what,
                     [](const Json& status) { return IsFinalState(status.value("state", "")); });
}

absl::StatusOr<Json> FollowUntil(const Client& client, const std::string& path,
                                 const std::string& what,
                                 const std::function<bool(const Json&)>& final) {
  Progress progress(what);
  const Clock& clock = SystemClock();
  const absl::Duration start = clock.Monotonic();
  absl::Duration heard = start;
  for (;;) {
    absl::StatusOr<Json> status = client.Get(path);
    if (status.ok()) {
      heard = clock.Monotonic();
      const Json counts = status->value("episodes", Json::object());
      const std::string state = status->value("state", "");
      const auto done = counts.value("done", int64_t{0});
      const auto total = counts.value("total", int64_t{0});
      if (state == "queued") {
        progress.ShowWaiting(done, total, NoteOf(*status));
      } else {
        progress.Show(done, total, NoteOf(*status));
      }
      if (final(*status)) return status;
    } else if (status.status().code() == absl::StatusCode::kInvalidArgument ||
               clock.Monotonic() - heard > kPatience) {
      return status;
    }
    absl::SleepFor(
        std::clamp((clock.Monotonic() - start) / kPollsInAWait, kShortestPoll, kLongestPoll));
  }
}

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

absl::StatusOr<Json> GetAllPages(const Client& client, const std::string& path,
                                 const std::string& rows) {
  Json all = {{rows, Json::array()}, {"unreadable", Json::array()}, {"next_before", nullptr}};
  int64_t before = std::numeric_limits<int64_t>::max();
  for (;;) {
    ASSIGN_OR_RETURN(const Json page,
                     client.Get(absl::StrCat(path, "?limit=1000&before=", before)));
    AddRows(page, rows, all);
    AddRows(page, "unreadable", all);
    const Json next = page.value("next_before", Json());
    // Each page begins below the one before, so that the loop ends.
    if (!next.is_number_integer() || next.get<int64_t>() >= before) return all;
    before = next.get<int64_t>();
  }
}

}  // namespace myograde::server
