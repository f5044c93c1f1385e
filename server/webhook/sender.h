// Delivers the events that wait in the store to the webhooks of server.json, each webhook from a
// thread of its own and in the order of its events. An event that is not taken is tried again with
// growing delays, and given up after a day; those after it wait. Nothing in the daemon waits for a
// webhook.
//
// Each event is delivered at least once: whoever is killed between a delivery and its row delivers
// it again after the next start, with the same id.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "server/metrics/metrics.h"
#include "server/store/store.h"
#include "server/webhook/webhook.h"

namespace myograde::server {

inline constexpr absl::Duration kFirstRetry = absl::Seconds(5);
inline constexpr absl::Duration kLongestRetry = absl::Minutes(15);

// The wait after the `attempts`-th attempt failed: doubled each time from kFirstRetry up to
// kLongestRetry, and of that the half to all of it, by `random` in [0, 1), so that daemons that
// lost the same receiver do not come back together. REQUIRES: attempts >= 1.
absl::Duration DelayAfter(int64_t attempts, double random);

// Safe from any thread, except for Start and Stop.
class WebhookSender {
 public:
  using Change = std::function<absl::Status(Transaction&)>;
  // Applies a change to the store, and waits for it for a bounded time.
  using Write = std::function<absl::Status(Change)>;
  struct Options {
    std::vector<Webhook> webhooks;
    ReaderPool& readers;
    Write write;
    Metrics& metrics;
    const Clock& clock;
  };

  // What `options` refers to must outlive it.
  explicit WebhookSender(Options options) : options_(std::move(options)) {}
  ~WebhookSender() { Stop(); }
  WebhookSender(const WebhookSender&) = delete;
  WebhookSender& operator=(const WebhookSender&) = delete;

  // Starts the threads.
  void Start();
  // Ends the attempts under way, and the threads.
  void Stop();

  const std::vector<Webhook>& webhooks() const { return options_.webhooks; }
  // nullptr: there is no such webhook.
  const Webhook* Find(const std::string& name) const;
  // Sends a webhook an event "test", at once and once, which no row of the store tells of.
  // InternalError: the host gives no random numbers.
  absl::StatusOr<PostResult> Test(const Webhook& webhook, const std::function<bool()>& stop) const;

 private:
  void Run(const Webhook& webhook);
  // Nullopt: nothing waits, or the store can't be read at the moment.
  std::optional<DeliveryRow> Next(const Webhook& webhook);
  void Deliver(const Webhook& webhook, const DeliveryRow& delivery);
  DeliveryRow After(const Webhook& webhook, DeliveryRow delivery, const PostResult& result);
  // Tries until the store takes it, or the daemon stops.
  void Record(const DeliveryRow& delivery);

  const Options options_;
  std::stop_source stop_;  // of all threads
  std::vector<std::thread> threads_;
};

}  // namespace myograde::server
