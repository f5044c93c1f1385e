#include "server/base/http_client.h"

#include <curl/curl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

constexpr int kLookEveryMs = 100;
constexpr long kSlowestBytes = 512;  // a second
// What libcurl leaves for OpenSSL's finding where its own check of the host fails.
constexpr long kNotLookedAt = 1;

struct ListDeleter {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};
using Headers = std::unique_ptr<curl_slist, ListDeleter>;

void Add(Headers& headers, const std::string& line) {
  headers.reset(curl_slist_append(headers.release(), line.c_str()));
}

// What libcurl's callbacks work on.
struct Exchange {
  const HttpRequest& request;
  CURL* easy;
  HttpAnswer& answer;
  int64_t file_size = 0;
  int64_t sent = 0;      // bytes of the body's file
  int64_t received = 0;  // bytes for the sink
};

// Returning less than it got ends the transfer.
size_t Take(char* bytes, size_t size, size_t count, void* self) {
  Exchange& exchange = *static_cast<Exchange*>(self);
  const std::string_view piece(bytes, size * count);
  long status = 0;
  curl_easy_getinfo(exchange.easy, CURLINFO_RESPONSE_CODE, &status);
  if (exchange.request.sink != nullptr && status == 200) {
    exchange.received += std::ssize(piece);
    curl_off_t total = 0;
    curl_easy_getinfo(exchange.easy, CURLINFO_CONTENT_LENGTH_DOWNLOAD_T, &total);
    if (exchange.request.progress != nullptr) {
      exchange.request.progress(exchange.received, std::max<int64_t>(total, 0));
    }
    return exchange.request.sink(piece) ? piece.size() : 0;
  }
  std::string& text = exchange.answer.text;
  text.append(piece.substr(0, exchange.request.most_text - text.size()));
  return text.size() < exchange.request.most_text ? piece.size() : 0;
}

size_t GiveFile(char* to, size_t size, size_t count, void* self) {
  Exchange& exchange = *static_cast<Exchange*>(self);
  ssize_t n;
  do {
    n = pread(exchange.request.body_file, to, size * count, exchange.sent);
  } while (n < 0 && errno == EINTR);
  if (n < 0) return CURL_READFUNC_ABORT;
  exchange.sent += n;
  if (exchange.request.progress != nullptr) {
    exchange.request.progress(exchange.sent, exchange.file_size);
  }
  return static_cast<size_t>(n);
}

// A connection that was kept turns out to be gone only when the body is on its way.
int SeekFile(void* self, curl_off_t offset, int origin) {
  if (origin != SEEK_SET) return CURL_SEEKFUNC_CANTSEEK;
  static_cast<Exchange*>(self)->sent = offset;
  return CURL_SEEKFUNC_OK;
}

void SetBody(CURL* easy, Exchange& exchange) {
  const HttpRequest& request = exchange.request;
  curl_easy_setopt(easy, CURLOPT_POST, 1L);
  if (request.body_file < 0) {
    curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE_LARGE,
                     static_cast<curl_off_t>(request.body->size()));
    curl_easy_setopt(easy, CURLOPT_POSTFIELDS, request.body->data());
    return;
  }
  struct stat info = {};
  fstat(request.body_file, &info);  // what can't be read fails in GiveFile
  exchange.file_size = info.st_size;
  curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(info.st_size));
  curl_easy_setopt(easy, CURLOPT_READFUNCTION, GiveFile);
  curl_easy_setopt(easy, CURLOPT_READDATA, &exchange);
  curl_easy_setopt(easy, CURLOPT_SEEKFUNCTION, SeekFile);
  curl_easy_setopt(easy, CURLOPT_SEEKDATA, &exchange);
  curl_easy_setopt(easy, CURLOPT_UPLOAD_BUFFERSIZE, 256L << 10);
}

void SetLimits(CURL* easy, const HttpRequest& request) {
  const auto ms = [](absl::Duration time) {
    return static_cast<long>(absl::ToInt64Milliseconds(time));
  };
  curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, ms(request.connect));
  if (request.time != absl::InfiniteDuration()) {
    curl_easy_setopt(easy, CURLOPT_TIMEOUT_MS, ms(request.time));
  }
  if (request.silence != absl::InfiniteDuration()) {
    curl_easy_setopt(easy, CURLOPT_LOW_SPEED_LIMIT, kSlowestBytes);
    curl_easy_setopt(easy, CURLOPT_LOW_SPEED_TIME,
                     static_cast<long>(absl::ToInt64Seconds(request.silence)));
  }
}

void SetOptions(CURL* easy, Exchange& exchange, Headers& headers) {
  const HttpRequest& request = exchange.request;
  Add(headers, "User-Agent: MyoGrade");
  Add(headers, "Expect:");
  for (const std::string& header : request.headers) Add(headers, header);
  if (request.body.has_value() || request.body_file >= 0) {
    Add(headers, absl::StrCat("Content-Type: ", request.type));
    SetBody(easy, exchange);
  }
  curl_easy_setopt(easy, CURLOPT_HTTPHEADER, headers.get());
  curl_easy_setopt(easy, CURLOPT_URL, request.url.c_str());
  curl_easy_setopt(easy, CURLOPT_PATH_AS_IS, 1L);
  if (!request.unix_socket.empty()) {
    curl_easy_setopt(easy, CURLOPT_UNIX_SOCKET_PATH, request.unix_socket.c_str());
  }
  curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(easy, CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
  curl_easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 0L);
  curl_easy_setopt(easy, CURLOPT_PROXY, "");
  curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
  // Nobody waits for a resolver that hangs.
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYPEER, 1L);
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYHOST, 2L);
  curl_easy_setopt(easy, CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
  // OpenSSL's variables, which libcurl does not ask for.
  const char* const file =
      request.ca_file.empty() ? std::getenv("SSL_CERT_FILE") : request.ca_file.c_str();
  const char* const folder = request.ca_file.empty() ? std::getenv("SSL_CERT_DIR") : nullptr;
  if (file != nullptr) curl_easy_setopt(easy, CURLOPT_CAINFO, file);
  if (folder != nullptr) curl_easy_setopt(easy, CURLOPT_CAPATH, folder);
  curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, Take);
  curl_easy_setopt(easy, CURLOPT_WRITEDATA, &exchange);
  SetLimits(easy, request);
}

// Runs the transfer to its end; false: it was stopped. libcurl keeps the timeouts, and the deadline
// is for whatever it does not count.
bool Transfer(CURLM* multi, const HttpRequest& request, CURLcode& code) {
  const Deadline deadline(request.time + absl::Seconds(1));
  code = CURLE_OPERATION_TIMEDOUT;
  int running = 1;
  while (running > 0 && !deadline.over()) {
    if (request.stop != nullptr && request.stop()) return false;
    curl_multi_perform(multi, &running);
    if (running > 0) curl_multi_poll(multi, nullptr, 0, kLookEveryMs, nullptr);
  }
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi, &left)) {
    if (message->msg == CURLMSG_DONE) code = message->data.result;
  }
  return true;
}

HttpAnswer::Failure FailureOf(CURLcode code, bool connected) {
  using Failure = HttpAnswer::Failure;
  switch (code) {
    case CURLE_OK: return Failure::kNone;
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_CONNECT: return Failure::kUnreachable;
    case CURLE_OPERATION_TIMEDOUT: return connected ? Failure::kTimeout : Failure::kUnreachable;
    case CURLE_PEER_FAILED_VERIFICATION: return Failure::kCertificate;
    case CURLE_SSL_CACERT_BADFILE: return Failure::kCaFile;
    case CURLE_SSL_CONNECT_ERROR: return Failure::kTls;
    case CURLE_WRITE_ERROR: return Failure::kNotTaken;
    default: return Failure::kOther;
  }
}

}  // namespace

// CURL and CURLM are both void.
HttpClient::HttpClient()
    : multi_(nullptr, [](void* multi) { curl_multi_cleanup(multi); }),
      easy_(nullptr, [](void* easy) { curl_easy_cleanup(easy); }) {
  static const CURLcode ready = curl_global_init(CURL_GLOBAL_DEFAULT);
  if (ready != CURLE_OK) return;
  multi_.reset(curl_multi_init());
  easy_.reset(curl_easy_init());
}

HttpAnswer HttpClient::Ask(const HttpRequest& request) {
  HttpAnswer answer;
  CURL* const easy = easy_.get();
  CURLM* const multi = multi_.get();
  if (easy == nullptr || multi == nullptr) {
    answer.failure = HttpAnswer::Failure::kOther;
    answer.problem = "there is no memory for a request";
    return answer;
  }
  curl_easy_reset(easy);
  Exchange exchange = {.request = request, .easy = easy, .answer = answer};
  Headers headers;
  char error[CURL_ERROR_SIZE] = "";
  SetOptions(easy, exchange, headers);
  curl_easy_setopt(easy, CURLOPT_ERRORBUFFER, error);
  CURLcode code = CURLE_FAILED_INIT;
  const bool stopped =
      curl_multi_add_handle(multi, easy) == CURLM_OK && !Transfer(multi, request, code);
  curl_multi_remove_handle(multi, easy);
  curl_easy_setopt(easy, CURLOPT_ERRORBUFFER, nullptr);
  long status = 0;
  curl_off_t connected = 0;
  curl_off_t ready = 0;
  curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &status);
  curl_easy_getinfo(easy, CURLINFO_SSL_VERIFYRESULT, &answer.certificate);
  curl_easy_getinfo(easy, CURLINFO_CONNECT_TIME_T, &connected);
  curl_easy_getinfo(easy, CURLINFO_PRETRANSFER_TIME_T, &ready);
  answer.status = static_cast<int>(status);
  if (answer.certificate == kNotLookedAt) answer.certificate = 0;
  answer.sent = ready > 0;
  answer.failure =
      stopped ? HttpAnswer::Failure::kStopped : FailureOf(code, connected > 0 || answer.sent);
  if (answer.failure != HttpAnswer::Failure::kNone) {
    answer.problem = *error != '\0' ? error : curl_easy_strerror(code);
  }
  return answer;
}

std::string QueryValue(const std::string& value) {
  const std::unique_ptr<char, decltype(&curl_free)> escaped(
      curl_easy_escape(nullptr, value.data(), static_cast<int>(value.size())), curl_free);
  return escaped == nullptr ? "" : escaped.get();
}

}  // namespace myograde::server
