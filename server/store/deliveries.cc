#include "server/store/deliveries.h"

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/secret.h"
#include "server/store/stored_row.h"
#include "server/store/submissions.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kEventIdBytes = 16;

constexpr StoredRows<DeliveryRow, 9> kDeliveries = {
    "delivery",
    "SELECT id, at, webhook, event, body_json, state, attempts, due_at, detail FROM delivery "};

}  // namespace

absl::Status Deliveries::Tell(const std::string& event, const Json& about) {
  if (context_.webhooks == nullptr) return absl::OkStatus();
  for (const WebhookConfig& hook : *context_.webhooks) {
    if (!hook.events.contains(event)) continue;
    ASSIGN_OR_RETURN(const std::string id, RandomBytes(kEventIdBytes));
    Json body = about;
    body["id"] = absl::BytesToHexString(id);
    body["event"] = event;
    body["at"] = TimeText(now_ms_);
    Run(db_, R"(INSERT INTO delivery (at, webhook, event, body_json, state, due_at)
        VALUES (?, ?, ?, ?, 'waiting', ?))",
        now_ms_, hook.name, event, CanonicalJson(body), now_ms_);
  }
  return absl::OkStatus();
}

void Deliveries::TellEnd(int64_t evaluation, EvaluationState state) {
  if (context_.webhooks == nullptr || context_.webhooks->empty()) return;
  // An evaluation must end even if nobody can be told.
  (void)Part([&]() -> absl::Status {
    const auto submission = FirstValue<int64_t>(
        db_, "SELECT submission FROM evaluation WHERE id = ? AND kind = 'original'", evaluation);
    if (submission == 0) return absl::OkStatus();
    // What the owner of the submission knows anyway, and neither a number nor a word of its result: a
    // phase may withhold those. A damaged row is told by its numbers.
    Json about = {
        {"evaluation", evaluation}, {"submission", submission}, {"state", EnumName(state)}};
    if (const absl::StatusOr<SubmissionRow> row = Submissions(context_).Find(submission); row.ok()) {
      about.update({{"team", row->team},
                    {"track", row->track},
                    {"profile", row->profile},
                    {"phase", TextOrNull(row->phase)},
                    {"ranked", row->ranked}});
    }
    const bool done = state == EvaluationState::kDone;
    return Tell(done ? kFinishedEvent : absl::StrCat("submission.", std::string(EnumName(state))),
                about);
  });
}

absl::Status Deliveries::Set(const DeliveryRow& delivery) {
  Run(db_, R"(UPDATE delivery SET state = ?, attempts = ?, due_at = ?, detail = ? WHERE id = ?)",
      delivery.state, delivery.attempts, delivery.due_at, delivery.detail, delivery.id);
  return absl::OkStatus();
}

absl::StatusOr<int64_t> Deliveries::AbandonAllBut(const std::set<std::string>& webhooks) {
  return Run(db_, R"(UPDATE delivery
      SET state = 'given_up', detail = 'server.json no longer has this webhook'
      WHERE state = 'waiting' AND webhook NOT IN (SELECT value FROM json_each(?)))",
             CanonicalJson(Json(webhooks)));
}

absl::Status Deliveries::Prune(int64_t before_ms) {
  Run(db_, "DELETE FROM delivery WHERE state != 'waiting' AND at < ?", before_ms);
  return absl::OkStatus();
}

absl::StatusOr<DeliveryRow> Deliveries::Next(const std::string& webhook) const {
  return kDeliveries.First(db_, absl::NotFoundError("nothing waits for this webhook"),
                           "WHERE webhook = ? AND state = 'waiting' ORDER BY id LIMIT 1", webhook);
}

Listed<DeliveryRow> Deliveries::List(const std::string& webhook, int64_t before,
                                     int64_t limit) const {
  return kDeliveries.List(
      db_, "WHERE id < ?1 AND (?2 = '' OR webhook = ?2) ORDER BY id DESC LIMIT ?3", before, webhook,
      limit);
}

std::vector<DeliveryCounts> Deliveries::Counts() const {
  constexpr StoredRows<DeliveryCounts, 5> kCounts = {
      "delivery", R"(SELECT webhook, sum(state = 'waiting'), sum(state = 'delivered'),
      sum(state = 'given_up'), ifnull(min(CASE WHEN state = 'waiting' THEN at END), 0)
      FROM delivery GROUP BY webhook )"};
  return kCounts.List(db_, "ORDER BY webhook").rows;
}

}  // namespace myograde::server
