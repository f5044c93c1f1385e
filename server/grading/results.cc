#include "server/grading/results.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "protocol/tracks/registry.h"
#include "scoring/aggregate_json.h"
#include "server/base/json_value.h"
#include "server/proof/merkle_tree.h"
#include "server/store/damage.h"
#include "server/store/episodes.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using Source = scoring::Metric::Source;

// The metric that every track has.
constexpr std::string_view kTimeMetric = "time_s";

std::optional<double> Optional(const Json& json, std::string_view key) {
  const Json& value = At(json, key);
  return value.is_number() ? std::optional(value.get<double>()) : std::nullopt;
}

}  // namespace

absl::StatusOr<EpisodeRow> JudgedRow(const Track& track, const EpisodeFacts& facts) {
  if (!AreFactsOf(*track.config.kind, facts.track)) {
    return absl::InternalError(
        absl::StrCat("episode ", facts.index, " came with the facts of another track"));
  }
  const scoring::Verdict verdict = track.scoring.judge(facts);
  if (verdict.outcome == Outcome::kGraderError || verdict.outcome == Outcome::kCancelled) {
    return absl::InternalError(absl::StrCat("episode ", facts.index, ": ",
                                            facts.fault.detail.empty()
                                                ? "its facts contradict themselves"
                                                : facts.fault.detail.c_str()));
  }
  EpisodeRow row;
  row.index = facts.index;
  row.seed = facts.seed;
  row.outcome = verdict.outcome;
  row.reason = verdict.reason;
  row.facts_json = CanonicalJson(EpisodeFactsToJson(facts));
  row.metrics_json = CanonicalJson(scoring::MetricsToJson(*track.scoring.track, verdict));
  if (facts.details.has_value()) row.details_json = CanonicalJson(DetailsToJson(*facts.details));
  return row;
}

absl::StatusOr<scoring::Verdict> ReadVerdict(const scoring::ScoredTrack& track,
                                             const EpisodeRow& row) {
  // Metrics are part of what results are compared by, so they stay as first written; others are
  // always computed from the facts.
  const Json kept = ParsedText(row.metrics_json);
  const Json facts = ParsedText(row.facts_json);
  const Json& number = At(facts, "steps");
  const int64_t steps = number.is_number_integer() ? number.get<int64_t>() : -1;
  if (steps < 0 || !Optional(kept, kTimeMetric).has_value()) {
    return DamagedRow({"episode", absl::StrCat(row.evaluation, "/", row.index),
                       steps < 0 ? "its \"facts_json\" has no steps"
                                 : "its \"metrics_json\" has no time"});
  }
  scoring::Verdict verdict;
  verdict.outcome = row.outcome;
  verdict.reason = row.reason;
  verdict.steps = steps;
  for (const scoring::Metric& metric : track.metrics) {
    verdict.metrics.push_back(
        metric.source == Source::kJudged  ? Optional(kept, metric.name)
        : metric.source == Source::kFacts ? Optional(At(facts, track.name), metric.of)
                                          : std::nullopt);
  }
  return verdict;
}

absl::StatusOr<std::vector<scoring::JudgedEpisode>> JudgedEpisodes(
    const scoring::ScoredTrack& track, const std::vector<EpisodeRow>& rows) {
  std::vector<scoring::JudgedEpisode> episodes;
  for (const EpisodeRow& row : rows) {
    ASSIGN_OR_RETURN(scoring::Verdict verdict, ReadVerdict(track, row));
    episodes.push_back({row.index, std::move(verdict)});
  }
  return episodes;
}

absl::StatusOr<scoring::Aggregate> AggregateRows(const scoring::ScoredTrack& track,
                                                 const std::vector<EpisodeRow>& rows) {
  ASSIGN_OR_RETURN(std::vector<scoring::JudgedEpisode> episodes, JudgedEpisodes(track, rows));
  return scoring::AggregateEpisodes(track.metrics, std::move(episodes));
}

absl::StatusOr<EvaluationResult> ComputeResult(const Track& track,
                                               const std::vector<EpisodeRow>& rows) {
  const scoring::ScoredTrack& scored = *track.scoring.track;
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate, AggregateRows(scored, rows));
  EvaluationResult result;
  result.state = aggregate.failed ? EvaluationState::kFailed : EvaluationState::kDone;
  if (aggregate.failed) {
    result.reason = absl::StrCat("every episode ended by a fault of the participant's program, the "
                                 "first as ", std::string(OutcomeName(rows.front().outcome)));
  }
  result.results_hash = ResultsHash(rows, track.config.seed_salt);
  result.aggregate = AggregateToJson(scored, aggregate);
  return result;
}

std::string ResultsHash(const std::vector<EpisodeRow>& rows, const std::string& seed_salt) {
  Sha256 hash;
  for (const EpisodeRow& row : rows) hash.Update(CanonicalResult(row, seed_salt) + "\n");
  return hash.FinishHex();
}

std::string ComputeMerkleRoot(const std::vector<EpisodeRow>& rows, const std::string& seed_salt) {
  std::vector<std::string> leaves;
  for (const EpisodeRow& row : rows) leaves.push_back(CanonicalResult(row, seed_salt));
  return MerkleRoot(leaves);
}

nlohmann::json ReceiptEntry(const EpisodeRow& row, const std::string& seed_salt) {
  Json entry = Json::parse(CanonicalResult(row, seed_salt));
  const Json facts = ParsedText(row.facts_json);
  entry["actions_digest"] = At(facts, "actions_digest");
  entry["log"] = At(At(facts, "log"), "sha256");
  return entry;
}

void AddStartUp(const std::vector<EpisodeRow>& rows, int64_t first, int64_t last, Json& use) {
  std::optional<double> cpu_s = Optional(use, "policy_cpu_s");
  std::optional<double> wall_s = Optional(use, "wall_s");
  for (const EpisodeRow& row : rows) {
    if (row.index < first || row.index > last) continue;
    const Json facts = ParsedText(row.facts_json);
    if (cpu_s) *cpu_s -= Optional(facts, "policy_cpu_s").value_or(0);
    if (wall_s) *wall_s -= Optional(facts, "wall_s").value_or(0);
  }
  if (cpu_s) use["startup_cpu_s"] = std::max(*cpu_s, 0.0);
  if (wall_s) use["startup_wall_s"] = std::max(*wall_s, 0.0);
}

}  // namespace myograde::server
