#include "server/api/resources.h"

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <absl/strings/str_cat.h>

#include "scoring/aggregate_json.h"
#include "server/api/episode_rows.h"
#include "server/api/redaction.h"
#include "server/base/json_value.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

// How often each outcome and each reason came up.
void AddOutcomes(const std::vector<EpisodeRow>& rows, Json& json) {
  json["outcomes"] = Json::object();
  json["reasons"] = Json::object();
  const auto count = [](Json& counts, std::string_view key) {
    Json& entry = counts[std::string(key)];
    entry = entry.is_null() ? 1 : entry.get<int64_t>() + 1;
  };
  for (const EpisodeRow& row : rows) {
    count(json["outcomes"], OutcomeName(row.outcome));
    if (row.reason != FailureReason::kNone) count(json["reasons"], row.reason.name());
  }
}

Json OutputToJson(const std::vector<BlockRow>& blocks, const std::vector<EpisodeRow>& rows) {
  Json list = Json::array();
  for (const BlockRow& block : blocks) {
    Json output = ParsedText(block.output_json);
    if (!output.is_object()) continue;
    output["block"] = block.id;
    output["first"] = block.first;
    output["last"] = block.last;
    AddStartUp(rows, block.first, block.last, output);
    list.push_back(std::move(output));
  }
  return list;
}

// The rows that are asked for, what all episodes come to together, and which of them to look at.
absl::Status AddEpisodes(const Transaction& reader, const Track& track, int64_t evaluation,
                         std::vector<EpisodeRow> rows,
                         const std::vector<scoring::JudgedEpisode>& judged,
                         const EpisodeSelection& selection, Json& json) {
  if (selection.needs_details()) {
    ASSIGN_OR_RETURN(auto details, reader.episodes.Details(evaluation));
    for (EpisodeRow& row : rows) {
      const auto its = details.find(row.index);
      if (its != details.end()) row.details_json = std::move(its->second);
    }
  }
  if (selection.rows) json["episode_rows"] = RowsToJson(rows, track.config.seed_salt, selection);
  return selection.summary ? AddSummary(track, rows, judged, json) : absl::OkStatus();
}

// Leaves the episodes of blocks that have ended.
void DropUnended(const std::vector<BlockRow>& blocks, std::vector<EpisodeRow>& rows) {
  std::set<int64_t> open;
  for (const BlockRow& block : blocks) {
    if (!IsFinal(block.state)) open.insert(block.id);
  }
  std::erase_if(rows, [&](const EpisodeRow& row) { return open.contains(row.block); });
}

// A rerun against its original; null for an original.
absl::StatusOr<Json> CompareEvaluations(const Transaction& reader, const EvaluationRow& evaluation,
                                        const std::vector<EpisodeRow>& rows,
                                        const std::string& seed_salt) {
  if (evaluation.kind != EvaluationKind::kRerun) return Json();
  ASSIGN_OR_RETURN(const EvaluationRow original,
                   reader.evaluations.Original(evaluation.submission));
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> its, reader.episodes.Of(original.id));
  // A rerun has the config of its original.
  RETURN_IF_ERROR(CheckResults(reader, original, its, seed_salt));
  return CompareRows(original.id, its, evaluation, rows);
}

absl::StatusOr<Json> EvaluationToJson(const Transaction& reader, const ApiContext& context,
                                      int64_t id, const EpisodeSelection& selection) {
  ASSIGN_OR_RETURN(EvaluationRow evaluation, reader.evaluations.Find(id));
  ASSIGN_OR_RETURN(const SubmissionRow submission, reader.submissions.Find(evaluation.submission));
  ASSIGN_OR_RETURN(const TrackPtr track, StoredTrack(reader, evaluation.config));
  const TrackConfig& config = track->config;
  const scoring::TrackScoring& scoring = track->scoring;
  const Visibility visibility = FindConfigVisibility(reader, context, config);
  ASSIGN_OR_RETURN(const std::vector<BlockRow> blocks, reader.blocks.Of(id));
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.episodes.Of(id));
  if (!visibility.progress) DropUnended(blocks, rows);
  ASSIGN_OR_RETURN(const std::vector<scoring::JudgedEpisode> judged,
                   JudgedEpisodes(*scoring.track, rows));
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate,
                   scoring::AggregateEpisodes(scoring.track->metrics, judged));
  RETURN_IF_ERROR(CheckResults(reader, evaluation, rows, config.seed_salt));
  ASSIGN_OR_RETURN(const std::vector<RepeatRow> repeats, reader.episodes.Repeats(id));

  Json json = SubmissionToJson(submission, evaluation, reader.episodes.Counts(id, !visibility.progress));
  json["kind"] = EnumName(evaluation.kind);
  json["rejudge"] = IdOrNull(evaluation.rejudge);
  json["ranked"] = submission.ranked && evaluation.kind == EvaluationKind::kOriginal;
  json["track_kind"] = config.kind->name;
  json["reason"] = TextOrNull(evaluation.reason);
  json["first"] = evaluation.first;
  json["last"] = evaluation.last;
  json["started_at"] = TimeToJson(evaluation.started_at);
  AddOutcomes(rows, json);
  json["aggregate"] = AggregateToJson(*scoring.track, aggregate);
  json["official_figures"] = scoring.official_figures;
  json["metrics"] = ShownMetrics(scoring);
  json["hashes"] = {{"artefact", submission.artefact},
                    {"config", evaluation.config},
                    {"seeds", evaluation.seeds},
                    {"results", ResultsHash(rows, config.seed_salt)}};
  json["merkle_root"] = rows.empty() ? Json() : Json(ComputeMerkleRoot(rows, config.seed_salt));
  json["grader"] = ParsedText(evaluation.grader_json);
  json["limits"] = config.effective.value("budgets", Json());
  json["output"] = OutputToJson(blocks, rows);
  json["not_repeatable"] = Json::array();
  for (const RepeatRow& repeat : repeats) {
    json["not_repeatable"].push_back({{"index", repeat.index}, {"differs", repeat.differs}});
  }
  ASSIGN_OR_RETURN(json["comparison"],
                   CompareEvaluations(reader, evaluation, rows, config.seed_salt));
  if (selection.rows || selection.summary) {
    RETURN_IF_ERROR(AddEpisodes(reader, *track, id, rows, judged, selection, json));
  }
  RedactEvaluation(json, visibility);
  if (selection.rows && !selection.fields.empty()) {
    json["episode_columns"] = ColumnsOf(selection.fields, json["episode_rows"]);
    json.erase("episode_rows");
  }
  return json;
}

// What is to be played again, all of which can be read.
absl::StatusOr<NewRerun> MakeRerun(const Transaction& reader, const ApiContext& context,
                                   int64_t submission, const RerunRequest& wanted) {
  RETURN_IF_ERROR(RequireSubmission(reader, submission));
  RETURN_IF_ERROR(reader.submissions.Find(submission).status());
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, reader.evaluations.Original(submission));
  // What can't be played must not be there afterwards.
  StoredContent content;
  ASSIGN_OR_RETURN(const StoredEvaluation stored, LoadEvaluation(reader, evaluation.id, content));
  const TrackConfig& config = stored.track->config;
  // A policy that plays its phase again has one more look at it, which no quota counts.
  if (!SeesAll(FindConfigVisibility(reader, context, config))) {
    return WithheldError(absl::StrCat(
        "submission ", submission, " can't be rerun yet: phase \"", config.phase,
        "\" withholds parts of results, which a rerun would show"));
  }
  const EvaluationRow& original = stored.evaluation;
  if (!IsFinal(original.state)) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", submission,
                     " has not ended; wait for it or cancel it before you rerun it"));
  }
  if (wanted.last.value_or(0) > original.last) {
    return absl::InvalidArgumentError(absl::StrCat("request: \"last\" is ", *wanted.last,
                                                   ", the last episode of submission ", submission,
                                                   " is ", original.last));
  }
  const Runtimes runtimes(context.config.runtimes, context.config.runtimes_dir);
  NewRerun rerun{
      submission,
      stored.submission.artefact,
      CanonicalJson(WithRuntimes(GraderBuild(context.cache_dir, {stored.artefact.adapter}),
                                 RuntimeDigests(runtimes, stored.artefact.runtimes))),
      {}};
  RETURN_IF_ERROR(HasArtefactFiles(context.data_dir, rerun.artefact));
  for (const BlockRow& block : stored.blocks) {
    const bool wants = block.last >= wanted.first.value_or(0) &&
                       block.first <= wanted.last.value_or(original.last);
    if (wants) rerun.blocks.emplace_back(block.first, block.last);
  }
  return rerun;
}

ApiResult GetResult(const ApiContext& context, const Transaction& reader, const Request& request) {
  const int64_t id = ReadId(request);
  ASSIGN_OR_RETURN(const EpisodeSelection selection, ParseEpisodes(request));
  RETURN_IF_ERROR(RequireSubmission(reader, id));
  RETURN_IF_ERROR(reader.submissions.Find(id).status());
  ASSIGN_OR_RETURN(const EvaluationRow original, reader.evaluations.Original(id));
  ASSIGN_OR_RETURN(Json body, EvaluationToJson(reader, context, original.id, selection));
  return ApiAnswer{200, std::move(body)};
}

ApiResult GetEvaluation(const ApiContext& context, const Transaction& reader,
                        const Request& request) {
  ASSIGN_OR_RETURN(const EpisodeSelection selection, ParseEpisodes(request));
  RETURN_IF_ERROR(RequireEvaluation(reader, ReadId(request)));
  ASSIGN_OR_RETURN(Json body, EvaluationToJson(reader, context, ReadId(request), selection));
  return ApiAnswer{200, std::move(body)};
}

ApiResult RerunAnswer(const ApiContext& context, const Accepted& accepted) {
  ASSIGN_OR_RETURN(const EvaluationRow row, ReadStore(context, [&](const Transaction& reader) {
    return reader.evaluations.Find(accepted.evaluation);
  }));
  return ApiAnswer{accepted.is_new() ? 201 : 200,
                   {{"evaluation", accepted.evaluation},
                    {"submission", accepted.submission},
                    {"kind", "rerun"},
                    {"state", EnumName(row.state)},
                    {"first", row.first},
                    {"last", row.last},
                    {"repeated", accepted.repeated}}};
}

ApiResult RerunSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const RerunRequest wanted, ParseRerun(body));
  ASSIGN_OR_RETURN(const RequestKey key, ReadRequestKey(request, body));
  ASSIGN_OR_RETURN(const std::optional<Accepted> earlier,
                   FindEarlier(context.readers, CallerKey(), key));
  if (earlier.has_value()) return RerunAnswer(context, *earlier);
  const int64_t submission = ReadId(request);
  ASSIGN_OR_RETURN(NewRerun rerun, ReadStore(context, [&](const Transaction& reader) {
    return MakeRerun(reader, context, submission, wanted);
  }));
  rerun.request_key = key;
  ASSIGN_OR_RETURN(const Accepted accepted,
                   context.engine.Rerun(rerun, CallerKey(), CallerIsOrganiser(),
                                        context.config.reruns, context.config.http.request));
  if (accepted.is_new()) {
    NoteAct(absl::StrCat("submission ", submission),
            absl::StrCat("evaluation ", accepted.evaluation));
  }
  return RerunAnswer(context, accepted);
}

}  // namespace

void AddEvaluations(Routes& routes, const ApiContext& context) {
  routes.Get(R"(/v1/submissions/(\d{1,18})/result)", Action::kReadSubmission,
             Bind(context, GetResult));
  routes.Get(R"(/v1/evaluations/(\d{1,18}))", Action::kReadSubmission,
             Bind(context, GetEvaluation));
  routes.Post(R"(/v1/submissions/(\d{1,18})/rerun)", Action::kRerun,
              Bind(context, RerunSubmission));
}

}  // namespace myograde::server
