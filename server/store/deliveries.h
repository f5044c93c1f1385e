// What webhooks are told: the rows of `delivery`. A row is written in the same transaction as what it
// tells of, so that none is told that did not happen, and none that happened is forgotten.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "server/config/webhook_config.h"
#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

struct DeliveryRow {
  int64_t id = 0;
  int64_t at = 0;
  std::string webhook;
  std::string event;
  std::string body_json;  // canonical; "id" in it is the same for every attempt
  std::string state;      // "waiting", "delivered", "given_up"
  int64_t attempts = 0;
  int64_t due_at = 0;  // of the next attempt, by the calendar
  std::string detail;  // what went wrong last
};

struct DeliveryCounts {
  std::string webhook;
  int64_t waiting = 0;
  int64_t delivered = 0;
  int64_t given_up = 0;
  int64_t oldest_waiting_at = 0;  // 0: none waits
};

// What webhooks are told, until they have taken it.
class Deliveries : StorePart {
 public:
  using StorePart::StorePart;

  // The oldest event that waits for a webhook. NotFoundError: none does; a damaged row (damage.h),
  // with its id.
  absl::StatusOr<DeliveryRow> Next(const std::string& webhook) const;
  // Newest first. `webhook` "" matches any; `before` is an id.
  Listed<DeliveryRow> List(const std::string& webhook, int64_t before, int64_t limit) const;
  // Of each webhook with rows, by name.
  std::vector<DeliveryCounts> Counts() const;
  // Adds what is to be told of an event, for each webhook that wants it.
  // `about`: an object; "id", "event" and "at" are added to it.
  absl::Status Tell(const std::string& event, const nlohmann::json& about);
  // How its latest attempt ended: state, attempts, due_at and detail.
  absl::Status Set(const DeliveryRow& delivery);
  // Gives up what waits for webhooks other than these; returns how many.
  absl::StatusOr<int64_t> AbandonAllBut(const std::set<std::string>& webhooks);
  // Removes what was delivered or given up, of events before then.
  absl::Status Prune(int64_t before_ms);
  // Tells that an evaluation has ended, if it is a submission's own.
  void TellEnd(int64_t evaluation, EvaluationState state);
};

}  // namespace myograde::server
