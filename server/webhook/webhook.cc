#include "server/webhook/webhook.h"

#include <curl/curl.h>
#include <unistd.h>

#include <memory>

#include <absl/strings/str_cat.h>

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
std::string ProblemOf(const std::string& text) {
  if (text.size() > kMaxUrl) return absl::StrCat("is longer than ", kMaxUrl, " bytes");
  const UrlPtr url(curl_url(), curl_url_cleanup);
  if (url == nullptr || curl_url_set(url.get(), CURLUPART_URL, text.c_str(), 0) != CURLUE_OK) {
    return "is no URL; give one like \"https://chat.example.org/myograde\"";
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

}  // namespace

absl::StatusOr<std::vector<Webhook>> LoadWebhooks(const std::vector<WebhookConfig>& configs) {
  std::vector<Webhook> webhooks;
  for (const WebhookConfig& config : configs) {
    const auto mistake = [&](const std::string& what) {
      return absl::InvalidArgumentError(
          absl::StrCat("server.json: webhook \"", config.name, "\": ", what));
    };
    if (const std::string problem = ProblemOf(config.url); !problem.empty()) {
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

Subscriptions SubscriptionsOf(const std::vector<Webhook>& webhooks) {
  Subscriptions subscriptions;
  for (const Webhook& webhook : webhooks) {
    subscriptions.push_back({webhook.config.name, webhook.config.events});
  }
  return subscriptions;
}

}  // namespace myograde::server
