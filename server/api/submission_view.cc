#include "server/api/submission_view.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/api/phase_sight.h"
#include "server/api/redaction.h"
#include "server/api/views.h"
#include "server/base/this_host.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The time `duration` from now; null if it is not known.
Json Ahead(const std::optional<absl::Duration>& duration, absl::Time now) {
  if (!duration || *duration == absl::InfiniteDuration()) return nullptr;
  return TimeToJson(absl::ToUnixMillis(now + *duration));
}

absl::StatusOr<Json> HistoryToJson(Reader& reader, int64_t submission, int64_t evaluation) {
  ASSIGN_OR_RETURN(std::vector<TransitionRow> rows, reader.Transitions("submission", submission));
  ASSIGN_OR_RETURN(std::vector<TransitionRow> more, reader.Transitions("evaluation", evaluation));
  rows.insert(rows.end(), more.begin(), more.end());
  Json history = Json::array();
  for (const TransitionRow& row : rows) {
    history.push_back({{"at", TimeToJson(row.at)},
                       {"of", row.entity},
                       {"from", TextOrNull(row.from)},
                       {"to", row.to},
                       {"who", row.who},
                       // Of a submission, it tells who else handed in the same bytes.
                       {"why", row.entity == "submission" && !CallerIsOrganiser()
                                   ? Json()
                                   : TextOrNull(row.why)}});
  }
  return history;
}

// Null as long as a job waits for a node.
Json HostOf(const LiveLease* live) {
  if (live == nullptr) return HostName();
  if (live->job.empty()) return live->begun ? Json(HostName()) : Json();  // it waits for a node
  return TextOrNull(live->node);
}

// The attempts of a lease that have ended.
Json AttemptsToJson(const std::vector<LeaseRunRow>& runs, int64_t lease) {
  Json attempts = Json::array();
  for (const LeaseRunRow& run : runs) {
    if (run.lease != lease) continue;
    attempts.push_back({{"attempt", run.attempt},
                        {"node", TextOrNull(run.node)},
                        {"job", TextOrNull(run.job)},
                        {"began_at", TimeToJson(run.began_at)},
                        {"ended_at", TimeToJson(run.ended_at)},
                        {"cpu_s", run.cpu_s},
                        {"energy_j", run.energy_j ? Json(*run.energy_j) : Json()},
                        {"how", RunEndName(run.how)}});
  }
  return attempts;
}

Json LeaseToJson(const LeaseRow& lease, const LiveLease* live) {
  const bool running = lease.state == LeaseState::kRunning;
  return {{"lease", lease.id},
          {"first", lease.first},
          {"last", lease.last},
          {"state", LeaseStateName(lease.state)},
          {"slot", running ? Json(lease.slot) : Json()},
          {"attempt", lease.attempt},
          {"faults", lease.faults},
          {"episode", running && live ? Json(live->episode) : Json()},
          {"step", running && live ? Json(live->step) : Json()},
          {"host", running ? HostOf(live) : Json()},
          {"job", running && live ? TextOrNull(live->job) : Json()},
          {"begun", running && live ? Json(live->begun) : Json()},
          {"process", running && live ? Json(live->process) : Json()},
          {"started_at", TimeToJson(lease.started_at)},
          {"deadline_at", TimeToJson(lease.deadline_at)},
          {"running_wall_s",
           running && live ? Json(absl::ToDoubleSeconds(live->running)) : Json()},
          {"silent_wall_s",
           running && live ? Json(absl::ToDoubleSeconds(live->silent)) : Json()},
          {"detail", TextOrNull(lease.detail)}};
}

// The rest at the pace so far; null without a pace.
Json Remaining(const EvaluationRow& evaluation, const EpisodeCounts& counts, int64_t now_ms) {
  if (evaluation.state != EvaluationState::kRunning || counts.done == 0) return nullptr;
  const double elapsed = static_cast<double>(now_ms - evaluation.started_at) / 1000;
  const auto left = static_cast<double>(evaluation.last - evaluation.first + 1 - counts.done);
  return std::max(elapsed, 0.0) * left / static_cast<double>(counts.done);
}

}  // namespace

nlohmann::json SubmissionToJson(const SubmissionRow& row, const EvaluationRow& evaluation,
                                const EpisodeCounts& counts) {
  return {{"submission", row.id},
          {"team", row.team},
          {"track", row.track},
          {"profile", row.profile},
          {"phase", TextOrNull(row.phase)},
          {"artefact", row.artefact},
          {"name", row.artefact_name},
          {"ranked", row.ranked},
          {"state", EvaluationStateName(evaluation.state)},
          {"evaluation", evaluation.id},
          {"episodes", CountsToJson(evaluation.last - evaluation.first + 1, counts)},
          {"accepted_at", TimeToJson(row.accepted_at)},
          {"finished_at", TimeToJson(evaluation.finished_at)}};
}

QueueOutlook AddOutlook(const ApiContext& context, const EvaluationRow& evaluation,
                        const EpisodeCounts& counts, nlohmann::json& json) {
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  QueueOutlook outlook = context.engine.OutlookOf(evaluation.id);
  json["queue"] = nullptr;
  if (outlook.place && evaluation.state == EvaluationState::kQueued) {
    json["queue"] = {{"position", outlook.place->position},
                     {"leases_ahead", outlook.place->leases_ahead}};
  }
  json["waiting"] = TextOrNull(outlook.waiting);
  json["started_at"] = TimeToJson(evaluation.started_at);
  const int64_t end = evaluation.finished_at == 0 ? now : evaluation.finished_at;
  json["running_wall_s"] = evaluation.started_at == 0
                               ? Json()
                               : Json(static_cast<double>(end - evaluation.started_at) / 1000);
  json["remaining_wall_s"] = Remaining(evaluation, counts, now);
  if (json["remaining_wall_s"].is_null()) json["remaining_wall_s"] = SecondsOrNull(outlook.end);
  json["estimated_end_at"] =
      json["remaining_wall_s"].is_null()
          ? Json()
          : Ahead(absl::Seconds(json["remaining_wall_s"].get<double>()), context.clock.Now());
  return outlook;
}

absl::StatusOr<nlohmann::json> SubmissionStatus(Reader& reader, const ApiContext& context,
                                                int64_t id) {
  ASSIGN_OR_RETURN(SubmissionRow row, reader.Submission(id));
  ASSIGN_OR_RETURN(const std::vector<EvaluationRow> evaluations, reader.Evaluations(id));
  const EvaluationRow& original = evaluations.front();
  ASSIGN_OR_RETURN(const std::vector<LeaseRow> leases, reader.Leases(original.id));
  ASSIGN_OR_RETURN(const std::vector<LeaseRunRow> runs, reader.LeaseRunsOf(original.id));
  ASSIGN_OR_RETURN(const std::vector<MarkRow> marks, reader.MarkHistory(id));
  ASSIGN_OR_RETURN(Json history, HistoryToJson(reader, id, original.id));
  ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context, row.phase));
  const EpisodeCounts counts = reader.Counts(original.id, !sight.progress);
  Json json = SubmissionToJson(row, original, counts);
  const QueueOutlook outlook = AddOutlook(context, original, counts, json);
  json["reason"] = TextOrNull(original.reason);
  json["owner"] = TextOrNull(outlook.owner);
  json["deadline_at"] = Ahead(outlook.deadline, context.clock.Now());
  json["history"] = std::move(history);
  std::set<int64_t> ids;
  for (const LeaseRow& lease : leases) ids.insert(lease.id);
  const std::map<int64_t, LiveLease> running = context.engine.Running(&ids);
  json["leases"] = Json::array();
  for (const LeaseRow& lease : leases) {
    const auto live = running.find(lease.id);
    json["leases"].push_back(LeaseToJson(lease, live == running.end() ? nullptr : &live->second));
    json["leases"].back()["attempts"] = AttemptsToJson(runs, lease.id);
  }
  json["marks"] = MarksToJson(marks);
  json["evaluations"] = Json::array();
  for (const EvaluationRow& evaluation : evaluations) {
    const RejudgeSight rejudge = reader.RejudgeOfEvaluation(evaluation.id);
    if (!CallerSees(rejudge)) continue;
    json["evaluations"].push_back({{"evaluation", evaluation.id},
                                   {"kind", EvaluationKindName(evaluation.kind)},
                                   {"state", EvaluationStateName(evaluation.state)},
                                   {"first", evaluation.first},
                                   {"last", evaluation.last},
                                   {"rejudge", IdOrNull(rejudge.rejudge)},
                                   {"config", ConfigOf(evaluation, row)}});
  }
  RedactStatus(json, sight);
  return json;
}

}  // namespace myograde::server
