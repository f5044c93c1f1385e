// The addresses that only read.
#include <unistd.h>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "server/api/api.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/store/schema.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

std::string HostName() {
  char name[256] = {};
  return gethostname(name, sizeof(name) - 1) == 0 ? name : "unknown";
}

Json SecondsOrNull(const std::optional<absl::Duration>& duration) {
  return duration ? Json(absl::ToDoubleSeconds(*duration)) : Json();
}

// A time that lies so far ahead; null if it is not known.
Json Ahead(const std::optional<absl::Duration>& duration, absl::Time now) {
  if (!duration || *duration == absl::InfiniteDuration()) return nullptr;
  return TimeToJson(absl::ToUnixMillis(now + *duration));
}

absl::StatusOr<Json> HistoryToJson(Reader& reader, int64_t submission, int64_t evaluation) {
  absl::StatusOr<std::vector<TransitionRow>> rows = reader.Transitions("submission", submission);
  if (!rows.ok()) return rows.status();
  absl::StatusOr<std::vector<TransitionRow>> more = reader.Transitions("evaluation", evaluation);
  if (!more.ok()) return more.status();
  rows->insert(rows->end(), more->begin(), more->end());
  Json history = Json::array();
  for (const TransitionRow& row : *rows) {
    history.push_back({{"at", TimeToJson(row.at)},
                       {"of", row.entity},
                       {"from", TextOrNull(row.from)},
                       {"to", row.to},
                       {"who", row.who},
                       {"why", TextOrNull(row.why)}});
  }
  return history;
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
          {"host", running ? Json(HostName()) : Json()},
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

Json SubmissionToJson(const SubmissionRow& row, const EvaluationRow& original,
                      const EpisodeCounts& counts) {
  return {{"submission", row.id},
          {"team", row.team},
          {"track", row.track},
          {"profile", row.profile},
          {"artefact", row.artefact},
          {"name", row.artefact_name},
          {"ranked", row.ranked},
          {"state", EvaluationStateName(original.state)},
          {"evaluation", original.id},
          {"episodes", CountsToJson(original.last - original.first + 1, counts)},
          {"accepted_at", TimeToJson(row.accepted_at)},
          {"finished_at", TimeToJson(original.finished_at)}};
}

}  // namespace

absl::StatusOr<Json> Api::Status(Reader& reader, int64_t id) {
  absl::StatusOr<SubmissionRow> row = reader.Submission(id);
  if (!row.ok()) return row.status();
  const absl::StatusOr<std::vector<EvaluationRow>> evaluations = reader.Evaluations(id);
  if (!evaluations.ok()) return evaluations.status();
  const EvaluationRow& original = evaluations->front();
  const absl::StatusOr<std::vector<LeaseRow>> leases = reader.Leases(original.id);
  if (!leases.ok()) return leases.status();
  const absl::StatusOr<std::vector<MarkRow>> marks = reader.MarkHistory(id);
  if (!marks.ok()) return marks.status();
  absl::StatusOr<Json> history = HistoryToJson(reader, id, original.id);
  if (!history.ok()) return history.status();
  const EpisodeCounts counts = reader.Counts(original.id);
  const int64_t now = absl::ToUnixMillis(clock_.Now());
  Json json = SubmissionToJson(*row, original, counts);
  const QueueOutlook outlook = engine_.OutlookOf(original.id);
  json["queue"] = nullptr;
  if (outlook.place && original.state == EvaluationState::kQueued) {
    json["queue"] = {{"position", outlook.place->position},
                     {"leases_ahead", outlook.place->leases_ahead}};
  }
  json["waiting"] = TextOrNull(outlook.waiting);
  json["reason"] = TextOrNull(original.reason);
  json["started_at"] = TimeToJson(original.started_at);
  const int64_t end = original.finished_at == 0 ? now : original.finished_at;
  json["running_wall_s"] = original.started_at == 0
                               ? Json()
                               : Json(static_cast<double>(end - original.started_at) / 1000);
  json["remaining_wall_s"] = Remaining(original, counts, now);
  if (json["remaining_wall_s"].is_null()) json["remaining_wall_s"] = SecondsOrNull(outlook.end);
  json["estimated_end_at"] =
      json["remaining_wall_s"].is_null()
          ? Json()
          : Ahead(absl::Seconds(json["remaining_wall_s"].get<double>()), clock_.Now());
  json["owner"] = TextOrNull(outlook.owner);
  json["deadline_at"] = Ahead(outlook.deadline, clock_.Now());
  json["history"] = *std::move(history);
  const std::map<int64_t, LiveLease> running = engine_.Running();
  json["leases"] = Json::array();
  for (const LeaseRow& lease : *leases) {
    const auto live = running.find(lease.id);
    json["leases"].push_back(LeaseToJson(lease, live == running.end() ? nullptr : &live->second));
  }
  json["marks"] = MarksToJson(*marks);
  json["evaluations"] = Json::array();
  for (const EvaluationRow& evaluation : *evaluations) {
    json["evaluations"].push_back({{"evaluation", evaluation.id},
                                   {"kind", evaluation.rerun ? "rerun" : "original"},
                                   {"state", EvaluationStateName(evaluation.state)},
                                   {"first", evaluation.first},
                                   {"last", evaluation.last}});
  }
  return json;
}

absl::StatusOr<Json> Api::Breakdown(Reader& reader, int64_t id, bool episodes) {
  absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(id);
  if (!evaluation.ok()) return evaluation.status();
  absl::StatusOr<SubmissionRow> submission = reader.Submission(evaluation->submission);
  if (!submission.ok()) return submission.status();
  const absl::StatusOr<TrackPtr> track = StoredTrack(reader, submission->config);
  if (!track.ok()) return track.status();
  const TrackConfig* config = &(*track)->config;
  const scoring::TrackScoring& scoring = (*track)->scoring;
  const absl::StatusOr<std::vector<EpisodeRow>> read = reader.Episodes(id);
  if (!read.ok()) return read.status();
  const std::vector<EpisodeRow>& rows = *read;
  absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(*scoring.track, rows);
  if (!aggregate.ok()) return aggregate.status();
  const absl::StatusOr<std::vector<LeaseRow>> leases = reader.Leases(id);
  if (!leases.ok()) return leases.status();
  const absl::StatusOr<std::vector<RepeatRow>> replays = reader.Repeats(id);
  if (!replays.ok()) return replays.status();

  Json json = SubmissionToJson(*submission, *evaluation, reader.Counts(id));
  json["kind"] = evaluation->rerun ? "rerun" : "original";
  json["ranked"] = submission->ranked && !evaluation->rerun;
  json["track_kind"] = config->kind->name;
  json["reason"] = TextOrNull(evaluation->reason);
  json["first"] = evaluation->first;
  json["last"] = evaluation->last;
  json["started_at"] = TimeToJson(evaluation->started_at);
  json["outcomes"] = Json::object();
  json["reasons"] = Json::object();
  for (const EpisodeRow& row : rows) {
    const auto count = [](Json& counts, std::string_view key) {
      Json& entry = counts[std::string(key)];
      entry = entry.is_null() ? 1 : entry.get<int64_t>() + 1;
    };
    count(json["outcomes"], OutcomeName(row.outcome));
    if (row.reason != FailureReason::kNone) count(json["reasons"], row.reason.name());
  }
  json["aggregate"] = AggregateToJson(*scoring.track, *aggregate);
  json["official_figures"] = scoring.official_figures;
  json["metrics"] = ShownMetrics(scoring);
  json["hashes"] = {{"artefact", submission->artefact},
                    {"config", submission->config},
                    {"seeds", submission->seeds},
                    {"results", ResultsHash(rows)}};
  json["merkle_root"] = rows.empty() ? Json() : Json(MerkleRootOf(rows));
  json["grader"] = Json::parse(evaluation->grader_json, nullptr, false);
  json["limits"] = LimitsToJson(*config);
  json["output"] = Json::array();
  for (const LeaseRow& lease : *leases) {
    if (lease.output_json.empty()) continue;
    Json output = Json::parse(lease.output_json, nullptr, false);
    output["lease"] = lease.id;
    output["first"] = lease.first;
    output["last"] = lease.last;
    json["output"].push_back(std::move(output));
  }
  json["not_repeatable"] = Json::array();
  for (const RepeatRow& replay : *replays) {
    json["not_repeatable"].push_back({{"index", replay.index}, {"differs", replay.differs}});
  }
  json["comparison"] = nullptr;
  if (evaluation->rerun) {
    const absl::StatusOr<EvaluationRow> original = reader.Original(submission->id);
    if (!original.ok()) return original.status();
    const absl::StatusOr<std::vector<EpisodeRow>> its = reader.Episodes(original->id);
    if (!its.ok()) return its.status();
    json["comparison"] = CompareRows(original->id, *its, *evaluation, rows);
  }
  if (episodes) {
    json["episode_rows"] = Json::array();
    for (const EpisodeRow& row : rows) json["episode_rows"].push_back(EpisodeToJson(row));
  }
  return json;
}

Api::Result Api::EvaluationAnswer(int64_t id, bool of_submission, const Request& request) {
  absl::Status status = CheckParameters(request, {"episodes"});
  const std::string episodes = request.get_param_value("episodes");
  if (!episodes.empty() && episodes != "0" && episodes != "1") {
    status.Update(absl::InvalidArgumentError("\"episodes\" must be 0 or 1"));
  }
  Answer answer;
  if (status.ok()) {
    status = readers_.Read([&](Reader& reader) -> absl::Status {
      int64_t evaluation = id;
      if (of_submission) {
        if (absl::Status found = reader.Submission(id).status(); !found.ok()) return found;
        const absl::StatusOr<EvaluationRow> original = reader.Original(id);
        if (!original.ok()) return original.status();
        evaluation = original->id;
      }
      absl::StatusOr<Json> json = Breakdown(reader, evaluation, episodes == "1");
      if (json.ok()) answer.body = *std::move(json);
      return json.status();
    });
  }
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

Api::Result Api::GetResult(const Request& request) {
  return EvaluationAnswer(std::stoll(request.matches[1]), /*of_submission=*/true, request);
}

Api::Result Api::GetEvaluation(const Request& request) {
  return EvaluationAnswer(std::stoll(request.matches[1]), /*of_submission=*/false, request);
}

Api::Result Api::GetSubmission(const Request& request) {
  Answer answer;
  const absl::Status status = readers_.Read([&](Reader& reader) -> absl::Status {
    absl::StatusOr<Json> json = Status(reader, std::stoll(request.matches[1]));
    if (json.ok()) answer.body = *std::move(json);
    return json.status();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

Api::Result Api::ListSubmissions(const Request& request) {
  absl::StatusOr<SubmissionFilter> filter = ParseFilter(request);
  if (!filter.ok()) return ErrorOf(filter.status());
  Json list = Json::array();
  Listed<SubmissionRow> found;
  bool more = false;
  const absl::Status status = readers_.Read([&](Reader& reader) {
    filter->team = reader.TeamOf(filter->team);
    found = reader.Submissions(*filter);
    more = std::ssize(found.rows) + std::ssize(found.damaged) == filter->limit;
    for (const SubmissionRow& row : found.rows) {
      const absl::StatusOr<EvaluationRow> original = reader.Original(row.id);
      if (original.ok()) {
        list.push_back(SubmissionToJson(row, *original, reader.Counts(original->id)));
      } else if (const std::optional<Damage> damage = DamageOf(original.status())) {
        found.damaged.push_back(*damage);
      } else {
        return original.status();
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return Answer{200,
                {{"submissions", std::move(list)},
                 {"unreadable", DamagedToJson(found.damaged)},
                 {"next_before", more ? Json(found.last_id) : Json()}}};
}

Api::Result Api::ListTracks(const Request&) {
  Json list = Json::array();
  for (const auto& [name, offer] : tracks_.entries()) {
    Json profiles = Json::array();
    for (const auto& [profile, track] : offer.profiles) {
      profiles.push_back({{"profile", profile},
                          {"config", track->config.hash},
                          {"episodes", track->config.seeds.size()},
                          {"episodes_per_lease", track->config.episodes_per_lease}});
    }
    Json boards = Json::array();
    for (const auto& [board, unused] : offer.profiles.begin()->second->scoring.boards) {
      boards.push_back(board);
    }
    list.push_back({{"track", name},
                    {"boards", std::move(boards)},
                    {"kind", offer.profiles.begin()->second->config.kind->name},
                    {"default_profile", offer.default_profile},
                    {"profiles", std::move(profiles)}});
  }
  return Answer{200, {{"tracks", std::move(list)}}};
}

Api::Result Api::Health(const Request&) {
  const LiveHealth health = engine_.Health();
  Json running = Json::array();
  for (const auto& [lease, live] : engine_.Running()) {
    running.push_back({{"lease", lease},
                       {"evaluation", live.evaluation},
                       {"submission", live.submission},
                       {"slot", live.slot},
                       {"process", live.process},
                       {"episode", live.episode},
                       {"step", live.step},
                       {"running_wall_s", absl::ToDoubleSeconds(live.running)},
                       {"silent_wall_s", absl::ToDoubleSeconds(live.silent)}});
  }
  Json unreadable = Json::array();
  for (const auto& [evaluation, why] : health.unreadable) {
    unreadable.push_back({{"evaluation", evaluation}, {"message", why}});
  }
  Json closed = Json::array();
  for (const auto& [slot, left] : health.closed_slots) {
    closed.push_back({{"slot", slot}, {"left", left}});
  }
  const bool paused = !health.host_trouble.empty();
  return Answer{
      200,
      {{"status", !health.store_trouble.empty() ? "store" : paused ? "paused" : "ok"},
       {"message", TextOrNull(health.store_trouble.empty() ? health.host_trouble
                                                           : health.store_trouble)},
       {"host",
        {{"name", HostName()},
         {"state", HostStateName(health.host)},
         {"reason", TextOrNull(health.host_trouble)},
         {"paused_wall_s", SecondsOrNull(health.paused_for)},
         {"next_test_wall_s", SecondsOrNull(health.next_test)}}},
       {"leases", std::move(running)},
       {"ending", health.ending},
       {"unreadable", std::move(unreadable)},
       {"closed_slots", std::move(closed)},
       {"version", GraderVersion()},
       {"api", 1},
       {"schema", SchemaMigrations().size()},
       {"pid", getpid()},
       {"slots", options_.config.scheduler.slots},
       {"running", health.running},
       {"pending_leases", health.pending},
       {"data", options_.data_dir},
       {"started_at", TimeToJson(absl::ToUnixMillis(options_.started_at))},
       {"uptime_wall_s", absl::ToDoubleSeconds(clock_.Monotonic() - began_)}}};
}

}  // namespace myograde::server
