#include "server/executor/node/http_channel.h"

#include <curl/curl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <optional>
#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/base/output_tail.h"
#include "server/executor/spool/folder.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr long kConnectMs = 15'000;
// Of small requests, and of those that carry files; the latter also end when they stand still.
constexpr long kShortMs = 60'000;
constexpr long kLongMs = 20 * 60'000;
constexpr long kSlowestBytes = 512;
constexpr long kSlowestSeconds = 60;
constexpr size_t kMostAnswer = 64u << 10;

struct ListDeleter {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};
using Headers = std::unique_ptr<curl_slist, ListDeleter>;

void Add(Headers& headers, const std::string& line) {
  headers.reset(curl_slist_append(headers.release(), line.c_str()));
}

// Where an answer goes: to a text, or to a file if it is a good one.
struct Answer {
  CURL* easy = nullptr;
  int file = -1;
  size_t most = kMostAnswer;
  int64_t most_file = 0;
  std::string text = {};
  absl::Status status = {};
};

size_t Take(char* bytes, size_t size, size_t count, void* self) {
  Answer& answer = *static_cast<Answer*>(self);
  const size_t length = size * count;
  long http = 0;
  curl_easy_getinfo(answer.easy, CURLINFO_RESPONSE_CODE, &http);
  if (answer.file >= 0 && http == 200) {
    answer.most_file -= static_cast<int64_t>(length);
    answer.status = answer.most_file < 0
                        ? absl::DataLossError("the packed submission is larger than the order says")
                        : WriteAll(answer.file, {bytes, length});
    return answer.status.ok() ? length : 0;
  }
  if (answer.text.size() + length > answer.most) {
    answer.status = absl::DataLossError("the daemon's answer is too long");
    return 0;
  }
  answer.text.append(bytes, length);
  return length;
}

size_t GiveFile(char* to, size_t size, size_t count, void* self) {
  for (;;) {
    const ssize_t n = read(*static_cast<int*>(self), to, size * count);
    if (n < 0 && errno == EINTR) continue;
    return n < 0 ? CURL_READFUNC_ABORT : static_cast<size_t>(n);
  }
}

// The sentence of an API's error.
std::string MessageOf(const std::string& text) {
  const absl::StatusOr<Json> json = ParseJson(text, "answer");
  if (json.ok() && json->is_object() && json->contains("error") && (*json)["error"].is_object()) {
    const auto message = (*json)["error"].find("message");
    if (message != (*json)["error"].end() && message->is_string()) {
      return PrintableUtf8(message->get<std::string>());
    }
  }
  return "it gave no reason";
}

absl::Status StatusOf(long http, const std::string& text) {
  if (http == 200) return absl::OkStatus();
  const std::string message = absl::StrCat("the daemon answered ", http, ": ", MessageOf(text));
  switch (http) {
    case 404:
    case 410: return absl::CancelledError(message);
    case 409: return absl::AlreadyExistsError(message);
    case 408:
    case 429: return absl::UnavailableError(message);
    case 507: return absl::ResourceExhaustedError(message);
    default: break;
  }
  // A proxy's or a busy daemon's; redirects are not followed.
  if (http >= 500) return absl::UnavailableError(message);
  return absl::FailedPreconditionError(message);
}

// What OpenSSL finds of a certificate before and after its time (X509_V_ERR_CERT_NOT_YET_VALID and
// X509_V_ERR_CERT_HAS_EXPIRED).
constexpr long kNotYetValid = 9;
constexpr long kExpired = 10;

absl::Status Failure(CURL* easy, CURLcode code, const char* error) {
  const std::string message = absl::StrCat("the daemon can't be reached: ",
                                           *error != '\0' ? error : curl_easy_strerror(code));
  long verified = 0;
  curl_easy_getinfo(easy, CURLINFO_SSL_VERIFYRESULT, &verified);
  switch (code) {
    case CURLE_OPERATION_TIMEDOUT: return absl::DeadlineExceededError(message);
    // Somebody else answers there, or the option --ca is wrong.
    case CURLE_PEER_FAILED_VERIFICATION:
      return verified == kNotYetValid || verified == kExpired ? absl::OutOfRangeError(message)
                                                              : absl::UnauthenticatedError(message);
    case CURLE_SSL_CACERT_BADFILE: return absl::PermissionDeniedError(message);
    case CURLE_URL_MALFORMAT: return absl::FailedPreconditionError(message);
    default: return absl::UnavailableError(message);
  }
}

bool IsAllowedUrl(const std::string& url) {
  if (absl::StartsWith(url, "https://")) return true;
  for (const char* local : {"http://127.0.0.1:", "http://[::1]:"}) {
    if (absl::StartsWith(url, local)) return true;
  }
  return false;
}

}  // namespace

struct HttpChannel::Request {
  std::string path;                        // of the address
  std::optional<std::string_view> body = {};  // of a POST; else a GET
  const char* type = "application/json";
  int body_file = -1;                      // in place of `body`, from its beginning
  int answer_file = -1;
  size_t most_answer = kMostAnswer;
  int64_t most_file = 0;
};

HttpChannel::HttpChannel(const HttpChannelOptions& options, Handle easy)
    : options_(options), easy_(std::move(easy)) {}

absl::StatusOr<std::unique_ptr<HttpChannel>> HttpChannel::Open(const HttpChannelOptions& options) {
  if (!IsAllowedUrl(options.url)) {
    return absl::InvalidArgumentError(absl::StrCat(
        options.url, ": must be the daemon's https address; the lease's token is sent there"));
  }
  if (options.token.empty() && !options.lease.empty()) {
    return absl::InvalidArgumentError("MYOGRADE_LEASE_TOKEN is not set; it must hold the lease's token");
  }
  static const CURLcode ready = curl_global_init(CURL_GLOBAL_DEFAULT);
  Handle easy(ready == CURLE_OK ? curl_easy_init() : nullptr,
              [](void* handle) { curl_easy_cleanup(handle); });
  if (easy == nullptr) return absl::InternalError("there is no memory for requests");
  return std::unique_ptr<HttpChannel>(new HttpChannel(options, std::move(easy)));
}

absl::StatusOr<std::string> HttpChannel::Ask(Request request) {
  CURL* const easy = easy_.get();
  curl_easy_reset(easy);  // keeps its connection
  const std::string url = absl::StrCat(absl::StripSuffix(options_.url, "/"), request.path);
  Headers headers;
  if (!options_.token.empty()) {
    Add(headers, absl::StrCat("Authorization: Bearer ", options_.token));
  }
  Add(headers, "User-Agent: MyoGrade");
  Add(headers, "Expect:");
  char error[CURL_ERROR_SIZE] = "";
  Answer answer = {.easy = easy,
                   .file = request.answer_file,
                   .most = request.most_answer,
                   .most_file = request.most_file};
  curl_easy_setopt(easy, CURLOPT_URL, url.c_str());
  curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 0L);
  curl_easy_setopt(easy, CURLOPT_PROXY, "");
  curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);
  curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, kConnectMs);
  const bool files = request.body_file >= 0 || request.answer_file >= 0;
  curl_easy_setopt(easy, CURLOPT_TIMEOUT_MS, files ? kLongMs : kShortMs);
  curl_easy_setopt(easy, CURLOPT_LOW_SPEED_LIMIT, kSlowestBytes);
  curl_easy_setopt(easy, CURLOPT_LOW_SPEED_TIME, kSlowestSeconds);
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYPEER, 1L);
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYHOST, 2L);
  curl_easy_setopt(easy, CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
  if (!options_.ca_file.empty()) {
    curl_easy_setopt(easy, CURLOPT_CAINFO, options_.ca_file.c_str());
  }
  if (request.body_file >= 0) {
    struct stat info;
    if (fstat(request.body_file, &info) != 0 || lseek(request.body_file, 0, SEEK_SET) != 0) {
      return DiskError("a log", "read");
    }
    curl_easy_setopt(easy, CURLOPT_POST, 1L);
    curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(info.st_size));
    curl_easy_setopt(easy, CURLOPT_READFUNCTION, GiveFile);
    curl_easy_setopt(easy, CURLOPT_READDATA, &request.body_file);
  } else if (request.body.has_value()) {
    curl_easy_setopt(easy, CURLOPT_POST, 1L);
    curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE_LARGE,
                     static_cast<curl_off_t>(request.body->size()));
    curl_easy_setopt(easy, CURLOPT_POSTFIELDS, request.body->data());
  }
  if (request.body_file >= 0 || request.body.has_value()) {
    Add(headers, absl::StrCat("Content-Type: ", request.type));
  }
  curl_easy_setopt(easy, CURLOPT_HTTPHEADER, headers.get());
  curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, Take);
  curl_easy_setopt(easy, CURLOPT_WRITEDATA, &answer);
  curl_easy_setopt(easy, CURLOPT_ERRORBUFFER, error);
  const CURLcode code = curl_easy_perform(easy);
  if (!answer.status.ok()) return answer.status;
  long http = 0;
  curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &http);
  // A body that is refused by its head ends the connection after the answer.
  if (code != CURLE_OK && http < 400) return Failure(easy, code, error);
  if (absl::Status status = StatusOf(http, answer.text); !status.ok()) return status;
  return std::move(answer.text);
}

std::string HttpChannel::OfLease(const std::string& path) const {
  return absl::StrCat("/v1/leases/", options_.lease, path);
}

absl::Status HttpChannel::Reach() { return Ask({.path = "/v1/live"}).status(); }

absl::StatusOr<NodeOrder> HttpChannel::Order() {
  const absl::StatusOr<std::string> text =
      Ask({.path = OfLease("/order"), .most_answer = kMostOrderBytes + 1});
  if (!text.ok()) return text.status();
  return NodeOrderFromText(*text, "the daemon's order");
}

absl::Status HttpChannel::PutClaim(const NodeClaim& claim) {
  const std::string text = NodeClaimToText(claim);
  return Ask({.path = OfLease("/claim"), .body = text}).status();
}

absl::Status HttpChannel::PutProof(const NodeProof& proof) {
  const std::string text = NodeProofToText(proof);
  return Ask({.path = OfLease("/proof"), .body = text}).status();
}

absl::Status HttpChannel::FetchArtefact(const NodeArtefact& artefact, int file) {
  if (ftruncate(file, 0) != 0 || lseek(file, 0, SEEK_SET) != 0) {
    return DiskError("the packed submission", "written");
  }
  return Ask({.path = OfLease("/artefact"), .answer_file = file, .most_file = artefact.archive_bytes})
      .status();
}

absl::Status HttpChannel::AddRecords(int64_t offset, std::string_view bytes) {
  const absl::StatusOr<std::string> text = Ask({.path = OfLease(absl::StrCat("/records?offset=", offset)),
                                                .body = bytes,
                                                .type = "application/octet-stream"});
  if (!text.ok()) return text.status();
  const absl::StatusOr<Json> json = ParseJson(*text, "the daemon's answer");
  if (!json.ok()) return absl::UnavailableError(json.status().message());
  ConfigReader reader(*json, "the daemon's answer");
  const bool stop = reader.Boolean("stop");
  const bool taken = reader.Boolean("taken");
  const int64_t size = reader.Integer("size", 0, INT64_MAX);
  if (!reader.mistake().ok()) return absl::UnavailableError(reader.mistake().message());
  if (stop) return absl::CancelledError("the daemon asked for the lease's end");
  if (taken) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the daemon has ", size, " bytes of records, and other ones "
                                          "than this node sent before byte ", offset));
}

absl::Status HttpChannel::PutLog(const std::string& log, int file) {
  return Ask({.path = OfLease(absl::StrCat("/logs/", log.substr(0, log.find('.')))),
              .type = "application/octet-stream",
              .body_file = file})
      .status();
}

absl::Status HttpChannel::PutEnd(const NodeEnd& end) {
  const std::string text = NodeEndToText(end);
  return Ask({.path = OfLease("/end"), .body = text}).status();
}

}  // namespace myograde::server
