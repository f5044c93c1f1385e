#include "server/webhook/post.h"

#include <curl/curl.h>

#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/webhook/signature.h"

namespace myograde::server {
namespace {

constexpr int kLookEveryMs = 100;
// Of an answer, which nobody reads.
constexpr size_t kMostAnswer = 64 << 10;

// CURL and CURLM are both void.
struct EasyDeleter {
  void operator()(CURL* easy) const { curl_easy_cleanup(easy); }
};
struct MultiDeleter {
  void operator()(CURLM* multi) const { curl_multi_cleanup(multi); }
};
struct ListDeleter {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};
using Easy = std::unique_ptr<CURL, EasyDeleter>;
using Multi = std::unique_ptr<CURLM, MultiDeleter>;
using Headers = std::unique_ptr<curl_slist, ListDeleter>;

// Counts and drops. Returning less than it got ends the transfer.
size_t Drop(char*, size_t size, size_t count, void* left) {
  auto& room = *static_cast<size_t*>(left);
  if (size * count > room) return 0;
  room -= size * count;
  return size * count;
}

void Add(Headers& headers, const std::string& line) {
  headers.reset(curl_slist_append(headers.release(), line.c_str()));
}

void SetOptions(CURL* easy, const Webhook& webhook, const std::string& body,
                const Headers& headers, char* error, size_t& room) {
  curl_easy_setopt(easy, CURLOPT_URL, webhook.config.url.c_str());
  curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 0L);
  curl_easy_setopt(easy, CURLOPT_PROXY, "");
  curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
  // Nobody waits for a resolver that hangs.
  curl_easy_setopt(easy, CURLOPT_QUICK_EXIT, 1L);
  curl_easy_setopt(easy, CURLOPT_TIMEOUT_MS,
                   static_cast<long>(absl::ToInt64Milliseconds(webhook.config.timeout)));
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYPEER, 1L);
  curl_easy_setopt(easy, CURLOPT_SSL_VERIFYHOST, 2L);
  curl_easy_setopt(easy, CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
  if (!webhook.config.ca_file.empty()) {
    curl_easy_setopt(easy, CURLOPT_CAINFO, webhook.config.ca_file.c_str());
  }
  curl_easy_setopt(easy, CURLOPT_POST, 1L);
  curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE, static_cast<long>(body.size()));
  curl_easy_setopt(easy, CURLOPT_POSTFIELDS, body.c_str());
  curl_easy_setopt(easy, CURLOPT_HTTPHEADER, headers.get());
  curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, Drop);
  curl_easy_setopt(easy, CURLOPT_WRITEDATA, &room);
  curl_easy_setopt(easy, CURLOPT_ERRORBUFFER, error);
}

// Runs the transfer to its end; false: it was stopped. libcurl keeps the timeout, and the deadline
// is for whatever it does not count.
bool Transfer(CURL* easy, absl::Duration timeout, const std::function<bool()>& stop,
              CURLcode& code) {
  const Multi multi(curl_multi_init());
  if (multi == nullptr || curl_multi_add_handle(multi.get(), easy) != CURLM_OK) {
    code = CURLE_OUT_OF_MEMORY;
    return true;
  }
  const Deadline deadline(timeout + absl::Seconds(1));
  code = CURLE_OPERATION_TIMEDOUT;
  int running = 1;
  bool stopped = false;
  while (running > 0 && !deadline.over() && !(stopped = stop())) {
    curl_multi_perform(multi.get(), &running);
    if (running > 0) curl_multi_poll(multi.get(), nullptr, 0, kLookEveryMs, nullptr);
  }
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi.get(), &left)) {
    if (message->msg == CURLMSG_DONE) code = message->data.result;
  }
  curl_multi_remove_handle(multi.get(), easy);
  return !stopped;
}

std::string ProblemOf(CURLcode code, long http, const char* error, absl::Duration timeout) {
  if (code == CURLE_OPERATION_TIMEDOUT) {
    return absl::StrCat("it was not done within ", absl::FormatDuration(timeout));
  }
  if (http >= 300 && http < 400) {
    return absl::StrCat("it answered ", http, ", and redirects are not followed; correct the URL");
  }
  if (http != 0 && (http < 200 || http >= 300)) return absl::StrCat("it answered ", http);
  if (code == CURLE_OK) return "";
  // An answer that is cut off because it does not end is one all the same.
  if (code == CURLE_WRITE_ERROR && http != 0) return "";
  return *error != '\0' ? std::string(error) : std::string(curl_easy_strerror(code));
}

}  // namespace

PostResult Post(const Webhook& webhook, const std::string& event_id, const std::string& body,
                absl::Time now, const std::function<bool()>& stop) {
  static const CURLcode ready = curl_global_init(CURL_GLOBAL_DEFAULT);
  const Easy easy(ready == CURLE_OK ? curl_easy_init() : nullptr);
  if (easy == nullptr) return {false, 0, "there is no memory for a request"};
  Headers headers;
  Add(headers, "Content-Type: application/json");
  Add(headers, "User-Agent: MyoGrade");
  Add(headers, "Expect:");
  Add(headers, absl::StrCat(kEventIdHeader, ": ", event_id));
  Add(headers, absl::StrCat(kSignatureHeader, ": ",
                            SignatureOf(webhook.secret, absl::ToUnixSeconds(now), body)));
  char error[CURL_ERROR_SIZE] = "";
  size_t room = kMostAnswer;
  SetOptions(easy.get(), webhook, body, headers, error, room);
  CURLcode code = CURLE_OK;
  if (!Transfer(easy.get(), webhook.config.timeout, stop, code)) {
    return {false, 0, "the daemon stopped meanwhile"};
  }
  long http = 0;
  curl_easy_getinfo(easy.get(), CURLINFO_RESPONSE_CODE, &http);
  std::string problem = ProblemOf(code, http, error, webhook.config.timeout);
  return {problem.empty(), static_cast<int>(http), std::move(problem)};
}

}  // namespace myograde::server
