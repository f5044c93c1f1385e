#include "server/daemon/results.h"

#include <absl/strings/str_cat.h>

#include "protocol/config_reader.h"
#include "protocol/lease.h"
#include "protocol/sha256.h"
#include "server/store/replay.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json OrNull(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

std::optional<double> Optional(const Json& json, const char* key) {
  const auto it = json.find(key);
  if (it == json.end() || !it->is_number()) return std::nullopt;
  return it->get<double>();
}

double OrZero(const Json& json, const char* key) { return Optional(json, key).value_or(0); }

Json MeanOrNull(const scoring::Mean& mean) { return mean.count == 0 ? Json() : Json(mean.value); }

Json SpreadToJson(const scoring::Spread& spread) {
  return {{"deviation", spread.deviation}, {"low", spread.low}, {"high", spread.high}};
}

Json SpreadOrNull(const scoring::Mean& mean) {
  return mean.count == 0 ? Json() : SpreadToJson(mean.spread);
}

}  // namespace

absl::StatusOr<EpisodeRow> JudgedRow(const Track& track, const EpisodeFacts& facts) {
  const bool locomotion = std::holds_alternative<LocomotionFacts>(facts.track);
  if (locomotion != (track.config.kind == TrackKind::kLocomotion)) {
    return absl::InternalError(
        absl::StrCat("episode ", facts.index, " came with the facts of another track"));
  }
  const scoring::Judgement judgement = JudgeEpisode(track.scoring, facts);
  if (judgement.outcome == Outcome::kGraderError || judgement.outcome == Outcome::kCancelled) {
    return absl::InternalError(absl::StrCat("episode ", facts.index, ": ",
                                            facts.fault.detail.empty()
                                                ? "its facts contradict themselves"
                                                : facts.fault.detail.c_str()));
  }
  EpisodeRow row;
  row.index = facts.index;
  row.seed = facts.seed;
  row.outcome = judgement.outcome;
  row.reason = judgement.reason;
  row.facts_json = CanonicalJson(EpisodeFactsToJson(facts));
  row.metrics_json = CanonicalJson(MetricsToJson(track.config.kind, judgement));
  return row;
}

nlohmann::json MetricsToJson(TrackKind kind, const scoring::Judgement& judgement) {
  const scoring::Metrics& metrics = judgement.metrics;
  const bool locomotion = kind == TrackKind::kLocomotion;
  return {{"success", judgement.outcome == Outcome::kSuccess ? 1 : 0},
          {"time_s", metrics.time},
          {"effort", OrNull(metrics.effort)},
          {"pain", locomotion ? OrNull(metrics.pain) : Json()},
          {"distance_m", locomotion ? Json(metrics.distance) : Json()},
          {"effort_sum", metrics.effort_sum},
          {"pain_sum", locomotion ? Json(metrics.pain_sum) : Json()},
          {"reported_time_s", metrics.reported_time},
          {"peak_force_n", locomotion ? Json() : Json(metrics.peak_force)}};
}

absl::StatusOr<scoring::Judgement> JudgementOf(const EpisodeRow& row) {
  const Json json = Json::parse(row.metrics_json, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !Optional(json, "time_s").has_value()) {
    return absl::DataLossError(absl::StrCat("the metrics of episode ", row.index,
                                            " of evaluation ", row.evaluation, " can't be read"));
  }
  scoring::Judgement judgement;
  judgement.outcome = row.outcome;
  judgement.reason = row.reason;
  judgement.metrics.time = OrZero(json, "time_s");
  judgement.metrics.effort = Optional(json, "effort");
  judgement.metrics.pain = Optional(json, "pain");
  judgement.metrics.distance = OrZero(json, "distance_m");
  judgement.metrics.effort_sum = OrZero(json, "effort_sum");
  judgement.metrics.pain_sum = OrZero(json, "pain_sum");
  judgement.metrics.reported_time = OrZero(json, "reported_time_s");
  judgement.metrics.peak_force = OrZero(json, "peak_force_n");
  return judgement;
}

absl::StatusOr<scoring::Aggregate> AggregateRows(const std::vector<EpisodeRow>& rows) {
  std::vector<scoring::JudgedEpisode> episodes;
  for (const EpisodeRow& row : rows) {
    absl::StatusOr<scoring::Judgement> judgement = JudgementOf(row);
    if (!judgement.ok()) return judgement.status();
    episodes.push_back({row.index, *judgement});
  }
  return scoring::AggregateEpisodes(std::move(episodes));
}

nlohmann::json AggregateToJson(TrackKind kind, const scoring::Aggregate& aggregate) {
  if (aggregate.episodes == 0) return nullptr;
  const bool locomotion = kind == TrackKind::kLocomotion;
  const scoring::Mean none;
  const scoring::Mean& pain = locomotion ? aggregate.pain : none;
  const scoring::Mean& distance = locomotion ? aggregate.distance : none;
  const scoring::Mean& pain_sum = locomotion ? aggregate.pain_sum : none;
  const scoring::Mean& force = locomotion ? none : aggregate.peak_force;
  return {{"episodes", aggregate.episodes},
          {"successes", aggregate.successes},
          {"success_rate", aggregate.success_rate()},
          {"time_s", MeanOrNull(aggregate.time)},
          {"effort", MeanOrNull(aggregate.effort)},
          {"pain", MeanOrNull(pain)},
          {"distance_m", MeanOrNull(distance)},
          {"effort_sum", MeanOrNull(aggregate.effort_sum)},
          {"pain_sum", MeanOrNull(pain_sum)},
          {"reported_time_s", MeanOrNull(aggregate.reported_time)},
          {"peak_force_n", MeanOrNull(force)},
          {"spread",
           {{"success_rate", SpreadToJson(aggregate.success_spread)},
            {"time_s", SpreadOrNull(aggregate.time)},
            {"effort", SpreadOrNull(aggregate.effort)},
            {"pain", SpreadOrNull(pain)},
            {"distance_m", SpreadOrNull(distance)}}}};
}

std::string ResultsHash(const std::vector<EpisodeRow>& rows) {
  Sha256 hash;
  for (const EpisodeRow& row : rows) hash.Update(CanonicalResult(row) + "\n");
  return hash.FinishHex();
}

nlohmann::json GraderBuild() { return {{"version", MYOGRADE_VERSION}}; }

}  // namespace myograde::server
