#include "server/webhook/webhook.h"

#include <curl/curl.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <unistd.h>

#include <array>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "server/base/http_client.h"
#include "server/base/ip_address.h"
#include "server/base/secret.h"

namespace myograde::server {
namespace {

constexpr size_t kMinSecret = 16;
constexpr size_t kMaxSecret = 1024;
constexpr size_t kMaxUrl = 2000;

using UrlPtr = std::unique_ptr<CURLU, void (*)(CURLU*)>;

// A part of a URL; "" if it has none.
std::string PartOf(CURLU* url, CURLUPart part) {
  char* text = nullptr;
  if (curl_url_get(url, part, &text, 0) != CURLUE_OK) return "";
  std::string found = text;
  curl_free(text);
  return found;
}

bool IsThisHost(std::string host) {
  if (host == "localhost") return true;
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  const std::optional<IpAddress> address = IpAddress::Parse(host);
  return address.has_value() && address->IsLoopback();
}

// Why a URL can't be used; "" if it can.
std::string FindProblem(const std::string& text) {
  if (text.size() > kMaxUrl) return absl::StrCat("is longer than ", kMaxUrl, " bytes");
  const UrlPtr url(curl_url(), curl_url_cleanup);
  if (url == nullptr || curl_url_set(url.get(), CURLUPART_URL, text.c_str(), 0) != CURLUE_OK) {
    return "is not a URL; give one like \"https://chat.example.org/myograde\"";
  }
  const std::string scheme = PartOf(url.get(), CURLUPART_SCHEME);
  if (scheme != "https" && scheme != "http") return "must begin with https://";
  if (scheme == "http" && !IsThisHost(PartOf(url.get(), CURLUPART_HOST))) {
    return "must begin with https://; plain http is for this host only (127.0.0.1, ::1, localhost)";
  }
  if (!PartOf(url.get(), CURLUPART_USER).empty() ||
      !PartOf(url.get(), CURLUPART_PASSWORD).empty()) {
    return "must have no user or password: the signature tells the receiver who sent an event";
  }
  if (!PartOf(url.get(), CURLUPART_FRAGMENT).empty()) return "must have no fragment (\"#…\")";
  return "";
}

std::string FindProblem(const HttpAnswer& answer, absl::Duration timeout) {
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

absl::StatusOr<std::vector<Webhook>> LoadWebhooks(const std::vector<WebhookConfig>& configs) {
  std::vector<Webhook> webhooks;
  for (const WebhookConfig& config : configs) {
    const auto mistake = [&](const std::string& what) {
      return absl::InvalidArgumentError(
          absl::StrCat("server.json: webhook \"", config.name, "\": ", what));
    };
    if (const std::string problem = FindProblem(config.url); !problem.empty()) {
      return mistake(absl::StrCat("its \"url\" ", problem));
    }
    absl::StatusOr<std::string> secret =
        ReadSecretFile(config.secret_file, kMinSecret, kMaxSecret);
    if (!secret.ok()) return mistake(std::string(secret.status().message()));
    if (!config.ca_file.empty() && access(config.ca_file.c_str(), R_OK) != 0) {
      return mistake(absl::StrCat(config.ca_file, ": the authority's certificate can't be read"));
    }
    webhooks.push_back({config, *std::move(secret)});
  }
  return webhooks;
}

std::string ComputeSignature(std::string_view secret, int64_t seconds, std::string_view body) {
  const std::string text = absl::StrCat(seconds, ".", std::string(body));
  std::array<uint8_t, 32> digest = {};
  unsigned size = digest.size();
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size);
  return absl::StrCat("t=", seconds, ",v1=", ToHex(digest));
}

PostResult Post(const Webhook& webhook, const std::string& event_id, const std::string& body,
                absl::Time now, const std::function<bool()>& stop) {
  const absl::Duration timeout = webhook.config.timeout;
  const std::string signature = ComputeSignature(webhook.secret, absl::ToUnixSeconds(now), body);
  HttpAnswer answer =
      HttpClient().Ask({.url = webhook.config.url,
                        .ca_file = webhook.config.ca_file,
                        .headers = {absl::StrCat("Idempotency-Key: ", event_id),
                                    absl::StrCat("X-MyoGrade-Signature: ", signature)},
                        .body = body,
                        .connect = timeout,
                        .time = timeout,
                        .stop = stop});
  const std::string problem = FindProblem(answer, timeout);
  return {problem.empty(), answer.status, problem};
}

}  // namespace myograde::server
