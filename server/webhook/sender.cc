#include "server/webhook/sender.h"

#include <algorithm>
#include <random>

#include <absl/strings/escaping.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/json_value.h"
#include "server/base/log_line.h"
#include "server/base/secret.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// How often a webhook without anything to do looks for more.
constexpr absl::Duration kLookEvery = absl::Seconds(1);
// Between attempts to write how a delivery ended.
constexpr absl::Duration kRecordEvery = absl::Seconds(1);
// Rows of what was delivered or given up stay for so long.
constexpr absl::Duration kKeep = absl::Hours(24 * 30);
constexpr absl::Duration kPruneEvery = absl::Hours(1);
constexpr size_t kTestIdBytes = 16;

double Random() {
  thread_local std::mt19937_64 bits{std::random_device()()};
  return std::uniform_real_distribution<double>(0, 1)(bits);
}

std::string IdOf(const DeliveryRow& delivery) {
  const Json body = ParsedText(delivery.body_json);
  return body.is_object() && body.contains("id") && body["id"].is_string()
             ? body["id"].get<std::string>()
             : absl::StrCat("delivery-", delivery.id);
}

}  // namespace

absl::Duration DelayAfter(int64_t attempts, double random) {
  constexpr int64_t kMostDoublings = 20;  // far beyond the longest
  const int64_t doublings = std::clamp<int64_t>(attempts - 1, 0, kMostDoublings);
  const absl::Duration whole =
      std::min(kFirstRetry * static_cast<double>(int64_t{1} << doublings), kLongestRetry);
  return whole * (0.5 + random / 2);
}

void WebhookSender::Start() {
  for (const Webhook& webhook : options_.webhooks) {
    threads_.emplace_back([this, &webhook] { Run(webhook); });
  }
}

void WebhookSender::Stop() {
  stop_.request_stop();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

const Webhook* WebhookSender::Find(const std::string& name) const {
  const auto found = std::find_if(options_.webhooks.begin(), options_.webhooks.end(),
                                  [&](const Webhook& one) { return one.config.name == name; });
  return found == options_.webhooks.end() ? nullptr : &*found;
}

absl::StatusOr<PostResult> WebhookSender::Test(const Webhook& webhook,
                                               const std::function<bool()>& stop) const {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(kTestIdBytes));
  const std::string id = absl::BytesToHexString(bytes);
  const absl::Time now = options_.clock.Now();
  const Json body = {{"id", id},
                     {"event", kTestEvent},
                     {"at", TimeText(now)}};
  const PostResult result = Post(webhook, id, CanonicalJson(body), now, stop);
  options_.metrics.CountWebhook(webhook.config.name, result.delivered);
  return result;
}

void WebhookSender::Run(const Webhook& webhook) {
  const LogScope scope({.webhook = webhook.config.name});
  const bool prunes = &webhook == &options_.webhooks.front();
  absl::Duration pruned = -absl::InfiniteDuration();
  while (!stop_.stop_requested()) {
    if (prunes && options_.clock.Monotonic() - pruned >= kPruneEvery) {
      pruned = options_.clock.Monotonic();
      const int64_t before = absl::ToUnixMillis(options_.clock.Now() - kKeep);
      // Those that can't be removed now are removed in an hour.
      (void)options_.write(
          [before](Transaction& writer) { return writer.deliveries.Prune(before); });
    }
    const std::optional<DeliveryRow> delivery = Next(webhook);
    if (!delivery.has_value()) {
      if (WaitForStop(stop_.get_token(), kLookEvery)) return;
      continue;
    }
    // The calendar may have been set back meanwhile, and no wait is longer than the longest.
    const absl::Duration wait =
        std::min(absl::FromUnixMillis(delivery->due_at) - options_.clock.Now(), kLongestRetry);
    if (wait > absl::ZeroDuration() && WaitForStop(stop_.get_token(), wait)) return;
    Deliver(webhook, *delivery);
  }
}

std::optional<DeliveryRow> WebhookSender::Next(const Webhook& webhook) {
  const absl::StatusOr<DeliveryRow> next = options_.readers.Read<DeliveryRow>(
      [&](const Transaction& reader) { return reader.deliveries.Next(webhook.config.name); });
  if (next.ok()) return *next;
  int64_t damaged = 0;
  const std::optional<Damage> damage = ExtractDamage(next.status());
  if (damage.has_value() && absl::SimpleAtoi(damage->key, &damaged)) {
    const std::string why(next.status().message());
    spdlog::error("webhook {}: delivery {} is given up: {}", webhook.config.name, damaged, why);
    options_.metrics.CountWebhookGivenUp(webhook.config.name);
    Record({.id = damaged,
            .webhook = {},
            .event = {},
            .body_json = {},
            .state = "given_up",
            .detail = why});
  }
  return std::nullopt;
}

void WebhookSender::Deliver(const Webhook& webhook, const DeliveryRow& delivery) {
  const PostResult result = Post(webhook, IdOf(delivery), delivery.body_json, options_.clock.Now(),
                                 [this] { return stop_.stop_requested(); });
  // An attempt that the daemon's own end cut off says nothing about the receiver.
  if (!result.delivered && stop_.stop_requested()) return;
  options_.metrics.CountWebhook(webhook.config.name, result.delivered);
  Record(After(webhook, delivery, result));
}

DeliveryRow WebhookSender::After(const Webhook& webhook, DeliveryRow delivery,
                                 const PostResult& result) {
  const LogScope scope({.delivery = delivery.id, .webhook = webhook.config.name});
  const absl::Time now = options_.clock.Now();
  delivery.state = "delivered";
  ++delivery.attempts;
  delivery.detail = result.problem;
  if (result.delivered) return delivery;
  if (now - absl::FromUnixMillis(delivery.at) >= webhook.config.give_up_after) {
    delivery.state = "given_up";
    options_.metrics.CountWebhookGivenUp(webhook.config.name);
    spdlog::error("webhook {}: delivery {} ({}) is given up after {} attempts: {}",
                  webhook.config.name, delivery.id, delivery.event, delivery.attempts,
                  result.problem);
    return delivery;
  }
  const absl::Duration delay = DelayAfter(delivery.attempts, Random());
  delivery.state = "waiting";
  delivery.due_at = absl::ToUnixMillis(now + delay);
  spdlog::warn("webhook {}: attempt {} of delivery {} ({}) failed, the next is in {} s: {}",
               webhook.config.name, delivery.attempts, delivery.id, delivery.event,
               absl::ToInt64Seconds(delay), result.problem);
  return delivery;
}

void WebhookSender::Record(const DeliveryRow& delivery) {
  do {
    const absl::Status status =
        options_.write([delivery](Transaction& writer) { return writer.deliveries.Set(delivery); });
    if (status.ok()) return;
  } while (!WaitForStop(stop_.get_token(), kRecordEvery));
}

}  // namespace myograde::server
