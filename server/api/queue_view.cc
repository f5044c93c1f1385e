#include "server/api/queue_view.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/api/phase_sight.h"
#include "server/api/readiness.h"
#include "server/api/redaction.h"
#include "server/api/submission_view.h"
#include "server/api/views.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kShow = 100;

struct Waiting {
  SubmissionRow row;
  EvaluationRow evaluation;
};

// What the engine plays or will play. nullopt: it has ended since the engine was asked.
absl::StatusOr<std::optional<Waiting>> FindWaiting(int64_t id, Reader& reader) {
  absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(id);
  if (absl::IsNotFound(evaluation.status())) return std::nullopt;  // it is newer than what is read
  if (!evaluation.ok()) return evaluation.status();
  if (IsFinal(evaluation->state)) return std::nullopt;
  ASSIGN_OR_RETURN(SubmissionRow row, reader.Submission(evaluation->submission));
  return Waiting{std::move(row), *std::move(evaluation)};
}

absl::StatusOr<Json> EntryOf(const Waiting& waiting, Reader& reader, const ApiContext& context) {
  ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context, waiting.row.phase));
  const EpisodeCounts counts = reader.Counts(waiting.evaluation.id, !sight.progress);
  Json entry = SubmissionToJson(waiting.row, waiting.evaluation, counts);
  RedactListed(entry, sight);
  AddOutlook(context, waiting.evaluation, counts, entry);
  return entry;
}

// What is played, or is about to be, comes first: the oldest of it.
void SortByPlace(Json& entries) {
  const auto key = [](const Json& entry) {
    const Json& queue = entry["queue"];
    return std::pair(queue.is_null() ? 0 : queue["position"].get<int64_t>(),
                     entry["submission"].get<int64_t>());
  };
  std::sort(entries.begin(), entries.end(),
            [&](const Json& a, const Json& b) { return key(a) < key(b); });
}

}  // namespace

absl::StatusOr<nlohmann::json> QueueView(Reader& reader, const ApiContext& context) {
  const std::vector<int64_t> queue =
      context.engine.QueueOf(CallerIsOrganiser() ? nullptr : &Caller().teams);
  std::vector<Damage> damaged;
  size_t total = queue.size();
  Json entries = Json::array();
  for (const int64_t id : queue) {
    if (entries.size() == kShow) break;
    const absl::StatusOr<std::optional<Waiting>> found = FindWaiting(id, reader);
    if (const auto damage = DamageOf(found.status())) {
      damaged.push_back(*damage);
      continue;
    }
    if (!found.ok()) return found.status();
    if (!found->has_value()) {
      --total;
      continue;
    }
    ASSIGN_OR_RETURN(Json entry, EntryOf(**found, reader, context));
    entries.push_back(std::move(entry));
  }
  SortByPlace(entries);
  const LiveHealth health = context.engine.Health();
  return Json{{"status", StatusOf(health)},
              {"slots", context.config.scheduler.slots},
              {"running", health.running},
              {"pending_leases", health.pending},
              {"total", total},
              {"submissions", std::move(entries)},
              {"unreadable", DamagedToJson(damaged)}};
}

}  // namespace myograde::server
