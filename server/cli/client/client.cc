#include "server/cli/client/client.h"

#include <absl/strings/cord.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <fcntl.h>
#include <grp.h>
#include <openssl/x509.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <limits>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/base/http_client.h"
#include "server/base/json_value.h"
#include "server/base/secret.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

// After a long wait the end need not be noticed at once, and each poll takes processor time from
// the policies that are graded.
constexpr absl::Duration kShortestPoll = absl::Milliseconds(250);
constexpr absl::Duration kLongestPoll = absl::Seconds(1);
constexpr int kPollsInAWait = 20;
constexpr absl::Duration kPatience = absl::Seconds(30);

// The daemon answers a request in 30 s and an upload in 900 s (server.json); a
// little more here, so that its own sentence arrives.
constexpr absl::Duration kAnswer = absl::Seconds(60);
constexpr absl::Duration kUpload = absl::Seconds(960);
// A daemon that was restarted in between is there again.
constexpr absl::Duration kBeforeRetry = absl::Seconds(1);
constexpr char kCodeKey[] = "myograde/answered-code";

std::string UserName(uid_t uid) {
  const passwd* user = ::getpwuid(uid);
  return user != nullptr ? user->pw_name : absl::StrCat("uid ", uid);
}

// By /etc/group, which a session reads only when it begins.
bool IsMember(const std::string& user, const group& of) {
  for (char** member = of.gr_mem; *member != nullptr; ++member) {
    if (user == *member) return true;
  }
  return false;
}

// Why a socket is not accessible, and what to do.
std::string ClosedSocket(const std::string& socket) {
  std::string closed = socket;  // the topmost without access for this user
  for (std::filesystem::path folder = std::filesystem::absolute(socket).parent_path();
       !folder.empty(); folder = folder.parent_path()) {
    if (::access(folder.c_str(), X_OK) != 0) closed = folder.string();
    if (folder == folder.root_path()) break;
  }
  struct stat info = {};
  const bool seen = ::stat(closed.c_str(), &info) == 0;
  // The group, other than root's, whose members may go on there.
  const mode_t rights = closed == socket ? S_IRGRP | S_IWGRP : S_IXGRP;
  const bool shared = seen && (info.st_mode & rights) == rights && info.st_gid != 0;
  const group* members = shared ? ::getgrgid(info.st_gid) : nullptr;
  const std::string beginning = absl::StrCat("this user has no access to the daemon on ", socket,
                                             ": ", closed, " is open to ");
  if (members != nullptr) {
    const std::string name = members->gr_name;
    const std::string user = UserName(::geteuid());
    return absl::StrCat(beginning, "the group ", name, ", and ", user,
                        IsMember(user, *members)
                            ? absl::StrCat(
                                " joined it after this session began; log in again, or run: "
                                "newgrp ", name)
                            : absl::StrCat(" is not in it; ask the administrator to run: adduser ",
                                           user, " ", name, ", then log in again"));
  }
  const std::string owner = seen ? UserName(info.st_uid) : "another user";
  return absl::StrCat(beginning, owner, " only; run this as ", owner,
                      ", or ask the organiser to start the daemon with --socket in a folder that "
                      "others may enter, and give that here with --socket");
}

absl::Status CheckSocket(const std::string& socket) {
  if (socket.size() >= sizeof(sockaddr_un::sun_path)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the socket's path ", socket, " is longer than ", sizeof(sockaddr_un::sun_path) - 1,
        " bytes, the limit of a Unix socket; give a shorter one with --socket"));
  }
  if (::access(socket.c_str(), R_OK | W_OK) == 0) return absl::OkStatus();
  if (errno == EACCES) return absl::UnavailableError(ClosedSocket(socket));
  return absl::UnavailableError(absl::StrCat(
      "can't reach a daemon: there is no socket ", socket,
      "; start one with \"myograde serve\", or name a running one with --data, --socket or "
      "--server"));
}

// What is wrong with the server's certificate; `code` is OpenSSL's.
std::string CertificateTrouble(const ServerChoice& choice, long code) {
  const std::string server = choice.address.Text();
  const std::string beginning = absl::StrCat("the certificate of ", server, " ");
  switch (code) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return beginning +
             "has expired; ask its organiser to renew it (or correct this host's clock)";
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return beginning + "is not valid yet; check this host's clock";
    case X509_V_OK:  // libcurl's own check of the host
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      return absl::StrCat(beginning, "is not for ", choice.address.host,
                          "; use the host name that the certificate is for, which its organiser "
                          "knows");
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
      if (!choice.ca_file.empty()) {
        return absl::StrCat(beginning, "is not signed by an authority in ", choice.ca_file,
                            "; ask the organiser for the right file");
      }
      return beginning +
             "is not signed by an authority that this host trusts; if your lab has its own "
             "authority, give its certificate with --ca-file";
    default:
      return absl::StrCat(beginning, "can't be trusted (", X509_verify_cert_error_string(code),
                          ")");
  }
}

std::string NetworkTrouble(const ServerChoice& choice, const HttpAnswer& answer) {
  using Failure = HttpAnswer::Failure;
  const std::string server = choice.address.Text();
  switch (answer.failure) {
    case Failure::kUnreachable:
      return absl::StrCat("can't reach a server at ", server,
                          "; check the address and the network, or ask its organiser");
    case Failure::kCaFile:
      return absl::StrCat(choice.ca_file,
                          ": has no PEM certificates; correct --ca-file, MYOGRADE_CA_FILE, or the "
                          "login");
    case Failure::kTls:
      return absl::StrCat(
          "can't make a TLS connection to ", server,
          ": the server may speak plain HTTP or an old TLS version, or have too many connections; "
          "check the address, or "
          "try again in a minute");
    case Failure::kCertificate:
      return CertificateTrouble(choice, answer.certificate);
    default:
      return absl::StrCat("the server at ", server, " did not answer (", answer.problem,
                          "); try again, or ask its organiser");
  }
}

// A request for `path` of `choice`, which ends when nothing moves for `silence`. It shows the token
// there. UnavailableError or InvalidArgumentError: the socket or the file of authorities can't be used.
absl::StatusOr<HttpRequest> RequestTo(const absl::StatusOr<ServerChoice>& choice,
                                      const std::string& path,
                                      absl::Duration silence = kAnswer) {
  if (!choice.ok()) return choice.status();
  HttpRequest request = {.url = absl::StrCat("http://myograde", path),
                         .silence = silence,
                         .most_text = std::numeric_limits<size_t>::max()};
  if (choice->address.network()) {
    const std::string& file = choice->ca_file;
    if (!file.empty() && ::access(file.c_str(), R_OK) != 0) {
      return absl::InvalidArgumentError(absl::StrCat(
          file, ": this file of trusted authorities can't be read (", std::strerror(errno),
          "); correct --ca-file, MYOGRADE_CA_FILE, or the login"));
    }
    request.url = choice->address.Text() + path;
    request.ca_file = choice->ca_file;
  } else {
    RETURN_IF_ERROR(CheckSocket(choice->address.socket));
    request.unix_socket = choice->address.socket;
  }
  if (!choice->token.empty()) request.headers = {"Authorization: Bearer " + choice->token};
  return request;
}

// Why a request to `choice` failed: UnavailableError with a sentence that says what to do.
absl::Status NoAnswer(const ServerChoice& choice, const HttpAnswer& answer) {
  const std::string where = choice.address.Text();
  if (choice.address.network()) {
    return absl::UnavailableError(absl::StrCat(
        NetworkTrouble(choice, answer),
        choice.by_login ? "; \"myograde logout\" returns to the daemon of this host" : ""));
  }
  if (answer.failure == HttpAnswer::Failure::kUnreachable) {
    return absl::UnavailableError(
        absl::StrCat("no daemon listens on ", where, "; start one with \"myograde serve\""));
  }
  return absl::UnavailableError(absl::StrCat("the daemon on ", where, " did not answer (",
                                             answer.problem, "); see its log, or try again"));
}

absl::StatusOr<Json> ParseAnswer(const HttpAnswer& answer, const ServerChoice& choice) {
  if (answer.failure != HttpAnswer::Failure::kNone) return NoAnswer(choice, answer);
  if (answer.status >= 300 && answer.status < 400) {
    return absl::InternalError(absl::StrCat(
        choice.address.Text(),
        " redirects requests, and redirects are not followed, because a token is for one server; "
        "give the daemon's own address"));
  }
  Json json = ParsedText(answer.text);
  const bool good = answer.status >= 200 && answer.status < 300;
  if (good && json.is_object()) return json;
  const Json error = json.is_object() ? json.value("error", Json()) : Json();
  std::string message = Sanitized(TextAt(error, "message"));
  if (message.empty()) {
    message = absl::StrCat("the daemon answered with HTTP status ", answer.status,
                           " and no readable body");
  }
  const bool refused = answer.status >= 400 && answer.status < 500 && answer.status != 429;
  absl::Status status =
      refused ? absl::InvalidArgumentError(message) : absl::InternalError(message);
  if (const std::string code = TextAt(error, "code"); !code.empty()) {
    status.SetPayload(kCodeKey, absl::Cord(code));
  }
  return status;
}

// Whether the request may have arrived though there is no answer.
bool IsLost(const HttpAnswer& answer) {
  return answer.failure != HttpAnswer::Failure::kNone && answer.sent;
}

}  // namespace

int ExitOfState(const std::string& state) {
  if (state == "done") return kDone;
  return state == "grader_error" ? kTrouble : kNoScore;
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
      const bool queued = state == "queued";
      progress.Show(done, total, queued ? Filled(*status, "queued[: {waiting}]") : state, queued);
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

Client::Client(absl::StatusOr<ServerChoice> choice) : choice_(std::move(choice)) {}

absl::StatusOr<Json> Client::Get(const std::string& path) const {
  ASSIGN_OR_RETURN(const HttpRequest request, RequestTo(choice_, path));
  const absl::StatusOr<Json> answer = ParseAnswer(HttpClient().Ask(request), *choice_);
  // A token that is not valid any more should not hide what is public; who one is, is about the token.
  if (AnsweredCode(answer.status()) != "bad_token" || choice_->token.empty() ||
      path == "/v1/whoami") {
    return answer;
  }
  ServerChoice nobody = *choice_;
  nobody.token.clear();
  ASSIGN_OR_RETURN(const HttpRequest again, RequestTo(nobody, path));
  absl::StatusOr<Json> shown = ParseAnswer(HttpClient().Ask(again), nobody);
  if (!shown.ok()) return answer;
  PrintToErrors(absl::StrCat("myograde: note: ", answer.status().message(),
                             ". Showing what the public sees; use \"myograde login\" to enter a "
                             "new token, or \"myograde logout\" to remove this one."));
  return shown;
}

absl::StatusOr<Json> Client::Post(const std::string& path, const Json& body, bool once) const {
  ASSIGN_OR_RETURN(const std::string key, RandomBytes(16));  // which no other request has
  // Invalid UTF-8 from the command line is sent as U+FFFD; dump would throw otherwise.
  const std::string text = body.dump(-1, ' ', false, Json::error_handler_t::replace);
  for (bool again = false;; again = true) {
    ASSIGN_OR_RETURN(HttpRequest request, RequestTo(choice_, path));
    request.body = text;
    if (once) request.headers.push_back("Idempotency-Key: " + absl::BytesToHexString(key));
    const HttpAnswer answer = HttpClient().Ask(request);
    if (!once || again || !IsLost(answer)) return ParseAnswer(answer, *choice_);
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
  ASSIGN_OR_RETURN(HttpRequest request, RequestTo(choice_, path, kUpload));
  request.body_file = input.get();
  request.type = type;
  request.progress = progress;
  const HttpAnswer answer = HttpClient().Ask(request);
  if (IsLost(answer)) {
    return absl::UnavailableError(absl::StrCat(
        "the daemon on ", choice_->address.Text(), " closed the connection during an upload of ",
        info.st_size, " bytes (", answer.problem,
        "): it may be larger than archive_bytes of server.json allows, or have taken longer than "
        "upload_s; see the daemon's log"));
  }
  return ParseAnswer(answer, *choice_);
}

absl::StatusOr<int64_t> Client::Download(
    const std::string& path, const std::function<absl::Status(std::string_view)>& sink,
    const std::function<void(int64_t, int64_t)>& progress) const {
  ASSIGN_OR_RETURN(HttpRequest request, RequestTo(choice_, path, kUpload));
  int64_t done = 0;
  absl::Status taken;
  request.progress = progress;
  request.sink = [&](std::string_view piece) {
    done += std::ssize(piece);
    taken = sink(piece);
    return taken.ok();
  };
  const HttpAnswer answer = HttpClient().Ask(request);
  RETURN_IF_ERROR(taken);
  if (answer.failure == HttpAnswer::Failure::kNone && answer.status == 200) return done;
  RETURN_IF_ERROR(ParseAnswer(answer, *choice_).status());
  return absl::InternalError("unexpected answer from the daemon; its version may differ from this "
                             "program's");
}

absl::StatusOr<Json> GetAllPages(const Client& client, const std::string& path,
                                 const std::string& rows) {
  Json all = {{rows, Json::array()}, {"next_before", nullptr}};
  int64_t before = std::numeric_limits<int64_t>::max();
  for (;;) {
    ASSIGN_OR_RETURN(const Json page,
                     client.Get(absl::StrCat(path, "?limit=1000&before=", before)));
    const Json more = page.value(rows, Json::array());
    if (more.is_array()) all[rows].insert(all[rows].end(), more.begin(), more.end());
    const Json next = page.value("next_before", Json());
    // Each page begins below the one before, so that the loop ends.
    if (!next.is_number_integer() || next.get<int64_t>() >= before) return all;
    before = next.get<int64_t>();
  }
}

Json AllPhases(const Json& answer) {
  Json phases = Json::array();
  for (const Json& challenge : answer.value("challenges", Json::array())) {
    const Json own = challenge.value("phases", Json::array());
    phases.insert(phases.end(), own.begin(), own.end());
  }
  return phases;
}

Json PhaseIn(const Json& answer, const std::string& name) {
  return RowWith(AllPhases(answer), "phase", name);
}

absl::StatusOr<Json> FindPhaseOf(const Client& client, const std::string& phase) {
  ASSIGN_OR_RETURN(const Json answer, client.Get("/v1/challenges"));
  Json known = PhaseIn(answer, phase);
  if (known.is_object()) return known;
  return absl::InvalidArgumentError(
      absl::StrCat("there is no phase \"", phase,
                   "\"; \"myograde phase status\" lists the phases"));
}

}  // namespace myograde::server
