#include "server/store/episodes.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/seed_commitment.h"
#include "protocol/tracks/registry.h"
#include "server/base/plain_text.h"
#include "server/store/connection.h"
#include "server/store/stored_row.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Facts without the clocks. Text that is not JSON is compared as it is, so that damaged rows differ
// instead of stopping the daemon.
Json Parse(const std::string& text) {
  Json json = ParsedText(text);
  return json.is_discarded() ? Json(text) : json;
}

// Removes a key from an object and returns its canonical text: equal bytes mean equal values.
std::string Take(Json& object, const char* key) {
  if (!object.is_object() || !object.contains(key)) return "";
  const std::string text = CanonicalJson(object[key]);
  object.erase(key);
  return text;
}

constexpr StoredRows<EpisodeRow, 9> kEpisodes = {
    .table = "episode",
    .select =
        "SELECT evaluation, idx, block, attempt, seed, outcome, reason, facts_json, metrics_json "
        "FROM episode ",
    .key_columns = 2,
    .wrong = [](const EpisodeRow& episode) {
      const bool failure = episode.outcome == Outcome::kFailure;
      return failure == (episode.reason != FailureReason::kNone)
                 ? ""
                 : "its \"outcome\" and its \"reason\" contradict each other";
    }};

constexpr StoredRows<RepeatRow, 2> kRepeats = {
    .table = "replay", .select = "SELECT id, idx, differs_json FROM replay ", .first = 1};

struct DetailsRow {
  int64_t index = 0;
  std::string json;
};
constexpr StoredRows<DetailsRow, 2> kDetails = {
    .table = "episode_details",
    .select = "SELECT id, idx, details_json FROM episode_details ",
    .first = 1};

constexpr char kTimesDropped[] = "standings_dropped";

}  // namespace

std::vector<std::string> DifferencesBetween(const EpisodeRow& a, const EpisodeRow& b) {
  Json facts_a = Parse(a.facts_json);
  Json facts_b = Parse(b.facts_json);
  // Takes a key from both.
  const auto differ = [&](const char* key) { return Take(facts_a, key) != Take(facts_b, key); };
  std::vector<std::string> differs;
  if (a.seed != b.seed) differs.push_back("seed");
  if (a.outcome != b.outcome) differs.push_back("outcome");
  if (a.reason != b.reason) differs.push_back("reason");
  if (a.metrics_json != b.metrics_json) differs.push_back("metrics");
  for (const char* key : {"steps", "sim_time", "clipped"}) {
    if (differ(key)) differs.push_back(key);
  }
  if (differ("actions_digest")) differs.push_back("actions");
  const bool digest_differs = differ("digest");
  // Not compared: a fault's evidence may hold a measured time, and its outcome is compared above; the
  // log follows from what is compared, and may have been truncated.
  for (const char* key : {"wall_s", "policy_cpu_s", "fault", "log", "seed"}) differ(key);
  if (CanonicalJson(facts_a) != CanonicalJson(facts_b)) differs.push_back("facts");
  if (digest_differs) differs.push_back("digest");
  return differs;
}

std::string CanonicalResult(const EpisodeRow& row, const std::string& seed_salt) {
  Json facts = Parse(row.facts_json);
  if (!facts.is_object()) facts = Json::object();
  Json result = {{"index", row.index},
                 {"outcome", OutcomeName(row.outcome)},
                 {"reason", row.reason.name()},
                 {"metrics", Parse(row.metrics_json)},
                 {"steps", facts["steps"]},
                 {"digest", facts["digest"]}};
  if (seed_salt.empty()) {
    result["seed"] = row.seed;
  } else {
    result["seed_commitment"] = SeedCommitment(seed_salt, row.index, row.seed);
  }
  return CanonicalJson(result);
}

absl::StatusOr<std::vector<EpisodeRow>> Episodes::Of(int64_t evaluation) const {
  return kEpisodes.All(db_, "WHERE evaluation = ? ORDER BY idx", evaluation);
}

absl::StatusOr<EpisodeRow> Episodes::OfLog(const std::string& sha256) const {
  return kEpisodes.First(db_, absl::NotFoundError(absl::StrCat("no episode has the log ", sha256)),
                         "WHERE log = ? ORDER BY evaluation, idx LIMIT 1", sha256);
}

absl::StatusOr<std::vector<RepeatRow>> Episodes::Repeats(int64_t evaluation) const {
  return kRepeats.All(db_, "WHERE evaluation = ? ORDER BY idx, attempt", evaluation);
}

EpisodeCounts Episodes::Counts(int64_t evaluation, bool ended_blocks) const {
  const auto [done, success, failure] = FirstRow<int64_t, int64_t, int64_t>(db_, R"(SELECT count(*),
      sum(outcome = 'success'), sum(outcome = 'failure') FROM episode WHERE evaluation = ?1
      AND (?2 = 0 OR block NOT IN (SELECT id FROM block WHERE evaluation = ?1
      AND finished_at IS NULL)))",
                                                                            evaluation, ended_blocks);
  return {done, success, failure, done - success - failure};
}

absl::StatusOr<std::map<int64_t, std::string>> Episodes::Details(int64_t evaluation) const {
  ASSIGN_OR_RETURN(const auto details,
                   kDetails.All(db_, "WHERE evaluation = ? ORDER BY idx", evaluation));
  std::map<int64_t, std::string> by_index;
  for (const DetailsRow& row : details) by_index[row.index] = row.json;
  return by_index;
}

absl::StatusOr<std::vector<std::string>> Episodes::Record(const EpisodeRow& row) {
  ASSIGN_OR_RETURN(const BlockRow block, Blocks(context_).Find(row.block));
  if (block.state != BlockState::kRunning || block.attempt != row.attempt) {
    return Blocks::Refused("given an episode", block,
                           absl::StrCat(", the episode is of ", row.attempt));
  }
  if (Run(db_, R"(INSERT INTO episode
      VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ifnull(json_extract(?8, '$.log.sha256'), ''))
      ON CONFLICT (evaluation, idx) DO NOTHING)",
          row.evaluation, row.index, row.block, row.attempt, static_cast<int64_t>(row.seed),
          OutcomeName(row.outcome), row.reason.name(), row.facts_json, row.metrics_json,
          now_ms_) == 1) {
    if (!row.details_json.empty()) {
      Run(db_, "INSERT INTO episode_details (evaluation, idx, details_json) VALUES (?, ?, ?)",
          row.evaluation, row.index, row.details_json);
    }
    Quotas(context_).ChargeFirstEpisode(
        row.evaluation,
        absl::StrCat("episode ", row.index, " ended as ", std::string(OutcomeName(row.outcome))));
    return std::vector<std::string>();
  }

  ASSIGN_OR_RETURN(const EpisodeRow kept,
                   kEpisodes.First(db_, NoSuch("episode", row.index),
                                   "WHERE evaluation = ? AND idx = ?", row.evaluation, row.index));
  const std::vector<std::string> differs = DifferencesBetween(kept, row);
  if (differs.empty()) return differs;
  Run(db_, R"(INSERT INTO replay (evaluation, idx, attempt, differs_json, facts_json, recorded_at)
      VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (evaluation, idx, attempt) DO NOTHING)",
      row.evaluation, row.index, row.attempt, CanonicalJson(Json(differs)), row.facts_json,
      now_ms_);
  return differs;
}

absl::Status Episodes::SetStanding(int64_t evaluation, const Json& aggregate) {
  Run(db_, "INSERT OR REPLACE INTO standing VALUES (?, ?)", evaluation, CanonicalJson(aggregate));
  return absl::OkStatus();
}

absl::Status Episodes::DropStandings() {
  db_.exec("DELETE FROM standing");
  SetMeta(db_, kTimesDropped, absl::StrCat(TimesDropped() + 1));
  return absl::OkStatus();
}

int64_t Episodes::TimesDropped() const { return MetaNumber(db_, kTimesDropped); }

void Episodes::ReadStandings(std::vector<StandingRow>& rows) const {
  std::map<int64_t, StandingRow*> by_evaluation;
  for (StandingRow& row : rows) by_evaluation[row.evaluation] = &row;
  const std::string evaluations = absl::StrJoin(
      rows, ",", [](std::string* out, const StandingRow& row) { absl::StrAppend(out, row.evaluation); });
  Statement select(db_, R"(SELECT e.id, a.name, v.aggregate_json
      FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
      JOIN artefact AS a ON a.hash = s.artefact LEFT JOIN standing AS v ON v.evaluation = e.id
      WHERE e.id IN (SELECT value FROM json_each(?)))",
                   absl::StrCat("[", evaluations, "]"));
  while (select.executeStep()) {
    StandingRow& row = *by_evaluation.at(select.getColumn(0).getInt64());
    std::string name = select.getColumn(1);
    if (IsUtf8(name)) row.artefact_name = std::move(name);
    Json aggregate = ParsedText(select.getColumn(2).getString());
    if (aggregate.is_object()) row.aggregate = std::move(aggregate);
  }
}

}  // namespace myograde::server
