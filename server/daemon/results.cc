#include "server/daemon/results.h"

#include <filesystem>
#include <map>
#include <mutex>

#include <absl/strings/str_cat.h>

#include "protocol/config_reader.h"
#include "protocol/lease.h"
#include "protocol/sha256.h"
#include "server/paths.h"
#include "server/proof/merkle.h"
#include "server/store/damage.h"
#include "server/store/replay.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
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

// The SHA-256 of a file, or null. Remembered while the file stays as it is, as it is asked for
// with every submission.
Json FileHash(const fs::path& path) {
  struct Known {
    fs::file_time_type changed;
    uintmax_t size;
    std::string hash;
  };
  static std::mutex mutex;
  static std::map<fs::path, Known> known;
  std::error_code error;
  const fs::file_time_type changed = fs::last_write_time(path, error);
  const uintmax_t size = error ? 0 : fs::file_size(path, error);
  if (error) return nullptr;
  const std::lock_guard lock(mutex);
  const auto it = known.find(path);
  if (it != known.end() && it->second.changed == changed && it->second.size == size) {
    return it->second.hash;
  }
  absl::StatusOr<std::string> hash = Sha256File(path);
  if (!hash.ok()) return nullptr;
  known[path] = {changed, size, *hash};
  return *std::move(hash);
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

namespace {

// What is taken from the facts whenever it is needed: metrics are part of what a result is
// compared by, so they stay as they were first written.
absl::StatusOr<scoring::Judgement> AddFacts(const EpisodeRow& row, scoring::Judgement judgement) {
  const Json facts = Json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
  const std::optional<double> steps = facts.is_object() ? Optional(facts, "steps") : std::nullopt;
  if (!steps.has_value()) {
    return absl::DataLossError(absl::StrCat("the facts of episode ", row.index, " of evaluation ",
                                            row.evaluation, " can't be read"));
  }
  judgement.metrics.steps = static_cast<int64_t>(*steps);
  const auto part = facts.find("manipulation");
  if (part != facts.end() && part->is_object()) {
    judgement.metrics.max_touch = Optional(*part, "max_touch");
  }
  return judgement;
}

}  // namespace

absl::StatusOr<scoring::Judgement> JudgementOf(const EpisodeRow& row) {
  const Json json = Json::parse(row.metrics_json, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !Optional(json, "time_s").has_value()) {
    return DamagedRow({"episode", absl::StrCat(row.evaluation, "/", row.index),
                       "its \"metrics_json\" has no time"});
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
  return AddFacts(row, judgement);
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
  const scoring::Mean& touch = locomotion ? none : aggregate.max_touch;
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
          {"max_touch_n", MeanOrNull(touch)},
          {"effort_over_steps", OrNull(aggregate.effort_over_steps)},
          {"pain_over_steps", locomotion ? OrNull(aggregate.pain_over_steps) : Json()},
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

std::string MerkleRootOf(const std::vector<EpisodeRow>& rows) {
  std::vector<std::string> leaves;
  for (const EpisodeRow& row : rows) leaves.push_back(CanonicalResult(row));
  return MerkleRoot(leaves);
}

std::string GraderVersion() { return MYOGRADE_VERSION; }

nlohmann::json GraderBuild(const std::string& cache_dir) {
  Json models = Json::object();
  std::error_code ignored;  // without the folder there are no compiled models
  for (const fs::directory_entry& entry :
       fs::directory_iterator(cache_dir + "/models", ignored)) {
    if (entry.path().extension() == ".mjb") {
      models[entry.path().filename().string()] = FileHash(entry.path());
    }
  }
  const absl::StatusOr<std::string> bin_dir = BinDir();
  return {{"version", MYOGRADE_VERSION},
          {"simulator", bin_dir.ok() ? FileHash(*bin_dir + "/myograde-sim") : Json()},
          {"mujoco", FileHash(cache_dir + "/mujoco-2.2.2/lib/libmujoco.so.2.2.2")},
          {"models", std::move(models)}};
}

nlohmann::json ReceiptEntry(const EpisodeRow& row) {
  Json entry = Json::parse(CanonicalResult(row));
  const Json facts = Json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
  const bool object = facts.is_object();
  entry["actions_digest"] = object ? facts.value("actions_digest", Json()) : Json();
  entry["log"] = object && facts.contains("log") ? facts["log"].value("sha256", Json()) : Json();
  return entry;
}

}  // namespace myograde::server
