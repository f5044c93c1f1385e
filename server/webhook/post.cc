#include "server/webhook/post.h"

#include <array>

#include <absl/strings/str_cat.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "protocol/base/sha256.h"
#include "server/base/http_client.h"

namespace myograde::server {
namespace {

std::string ProblemOf(const HttpAnswer& answer, absl::Duration timeout) {
  using Failure = HttpAnswer::Failure;
  const int http = answer.status;
  if (answer.failure == Failure::kStopped) return "the daemon stopped meanwhile";
  if (answer.failure == Failure::kTimeout) {
    return absl::StrCat("it was not done within ", absl::FormatDuration(timeout));
  }
  if (http >= 300 && http < 400) {
    return absl::StrCat("it answered ", http, ", and redirects are not followed; correct the URL");
  }
  if (http != 0 && (http < 200 || http >= 300)) return absl::StrCat("it answered ", http);
  // An answer that is cut off because it does not end is one all the same.
  if (answer.failure == Failure::kNotTaken && http != 0) return "";
  return answer.problem;
}

}  // namespace

std::string SignatureOf(std::string_view secret, int64_t seconds, std::string_view body) {
  const std::string text = absl::StrCat(seconds, ".", std::string(body));
  std::array<uint8_t, 32> digest = {};
  unsigned size = digest.size();
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size);
  return absl::StrCat("t=", seconds, ",v1=", HexOf(digest));
}

PostResult Post(const Webhook& webhook, const std::string& event_id, const std::string& body,
                absl::Time now, const std::function<bool()>& stop) {
  const absl::Duration timeout = webhook.config.timeout;
  const std::string signature = SignatureOf(webhook.secret, absl::ToUnixSeconds(now), body);
  HttpAnswer answer =
      HttpClient().Ask({.url = webhook.config.url,
                        .ca_file = webhook.config.ca_file,
                        .headers = {absl::StrCat(kEventIdHeader, ": ", event_id),
                                    absl::StrCat(kSignatureHeader, ": ", signature)},
                        .body = body,
                        .connect = timeout,
                        .time = timeout,
                        .stop = stop});
  const std::string problem = ProblemOf(answer, timeout);
  return {problem.empty(), answer.status, problem};
}

}  // namespace myograde::server
