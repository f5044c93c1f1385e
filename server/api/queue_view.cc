#include "server/api/queue_view.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "server/api/caller.h"
#include "server/api/phase_sight.h"
#include "server/api/redaction.h"
#include "server/api/submission_view.h"
#include "server/api/views.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kLookAt = 1000;  // submissions of each state
constexpr size_t kShow = 100;

struct Waiting {
  SubmissionRow row;
  EvaluationRow evaluation;
  int64_t position = 0;  // in the queue; 0: it is played, or is about to be
};

// All of one state that the caller may see. What can't be read is in `damaged`.
absl::StatusOr<std::vector<Waiting>> AllIn(EvaluationState state, Reader& reader,
                                           const ApiContext& context,
                                           std::vector<Damage>& damaged) {
  SubmissionFilter filter;
  filter.state = state;
  filter.limit = kLookAt;
  if (!CallerIsOrganiser()) filter.teams = Caller().teams;
  Listed<SubmissionRow> found = reader.Submissions(filter);
  damaged.insert(damaged.end(), found.damaged.begin(), found.damaged.end());
  std::vector<Waiting> all;
  for (SubmissionRow& row : found.rows) {
    absl::StatusOr<EvaluationRow> original = reader.Original(row.id);
    if (const auto damage = DamageOf(original.status())) {
      damaged.push_back(*damage);
      continue;
    }
    if (!original.ok()) return original.status();
    int64_t position = 0;
    if (state == EvaluationState::kQueued) {
      const QueueOutlook outlook = context.engine.OutlookOf(original->id);
      position = outlook.place ? outlook.place->position : std::numeric_limits<int64_t>::max();
    }
    all.push_back({std::move(row), *std::move(original), position});
  }
  return all;
}

absl::StatusOr<Json> EntryOf(const Waiting& waiting, Reader& reader, const ApiContext& context) {
  const absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, waiting.row.phase);
  if (!sight.ok()) return sight.status();
  const EpisodeCounts counts = reader.Counts(waiting.evaluation.id);
  Json entry = SubmissionToJson(waiting.row, waiting.evaluation, counts);
  RedactListed(entry, *sight);
  AddOutlook(context, waiting.evaluation, counts, entry);
  return entry;
}

}  // namespace

absl::StatusOr<nlohmann::json> QueueView(Reader& reader, const ApiContext& context) {
  std::vector<Damage> damaged;
  std::vector<Waiting> all;
  for (const EvaluationState state : {EvaluationState::kRunning, EvaluationState::kQueued}) {
    absl::StatusOr<std::vector<Waiting>> some = AllIn(state, reader, context, damaged);
    if (!some.ok()) return some.status();
    std::move(some->begin(), some->end(), std::back_inserter(all));
  }
  std::sort(all.begin(), all.end(), [](const Waiting& a, const Waiting& b) {
    return std::tuple(a.position, a.row.id) < std::tuple(b.position, b.row.id);
  });
  const size_t total = all.size();
  all.resize(std::min(total, kShow));
  Json entries = Json::array();
  for (const Waiting& waiting : all) {
    absl::StatusOr<Json> entry = EntryOf(waiting, reader, context);
    if (!entry.ok()) return entry.status();
    entries.push_back(*std::move(entry));
  }
  const LiveHealth health = context.engine.Health();
  const char* status = !health.store_trouble.empty()  ? "store"
                       : !health.host_trouble.empty() ? "paused"
                                                      : "ok";
  return Json{{"status", status},
              {"slots", context.config.scheduler.slots},
              {"running", health.running},
              {"pending_leases", health.pending},
              {"total", total},
              {"submissions", std::move(entries)},
              {"unreadable", DamagedToJson(damaged)}};
}

}  // namespace myograde::server
