#include "server/cli/offline/record_boards.h"

#include <optional>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "scoring/aggregate_json.h"
#include "server/base/json_value.h"
#include "protocol/tracks/registry.h"
#include "server/cli/terminal/terminal.h"
#include "server/grading/leaderboard.h"
#include "server/grading/results.h"
#include "server/proof/receipt.h"
#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The row that a receipt's entry was made of, as far as numbers follow from it.
absl::StatusOr<EpisodeRow> RowOfEntry(const Json& entry) {
  EpisodeRow row;
  row.index = entry.at("index").get<int64_t>();
  const std::optional<Outcome> outcome = ParseOutcome(TextAt(entry, "outcome"));
  const std::optional<FailureReason> reason = ParseFailureReason(TextAt(entry, "reason"));
  if (!outcome.has_value() || !reason.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrCat("the outcome of its episode ", row.index, " is not known to this program"));
  }
  row.outcome = *outcome;
  row.reason = *reason;
  row.metrics_json = CanonicalJson(entry.value("metrics", Json()));
  row.facts_json = CanonicalJson({{"steps", entry.value("steps", Json())}});
  return row;
}

// A receipt has no facts but the steps: numbers of other facts are taken from its aggregate, which
// is signed; no board ranks by them.
void TakeNumbersOfFacts(const scoring::ScoredTrack& track, const Json& said, Json& aggregate) {
  if (!said.is_object() || !aggregate.is_object()) return;
  for (const scoring::Metric& metric : track.metrics) {
    if (metric.source != scoring::Metric::Source::kFacts) continue;
    const std::string name(metric.name);
    if (said.contains(name)) aggregate[name] = said[name];
    const Json spread = said.value("spread", Json());
    if (spread.is_object() && spread.contains(name)) aggregate["spread"][name] = spread[name];
  }
}

absl::StatusOr<std::vector<StandingRow>> ListStandings(
    const BoardState& record, const Marks& marks, const std::map<int64_t, ReceivedResult>& results,
    const std::string& config) {
  std::vector<StandingRow> standings;
  for (StandingRow& row : record.Candidates(config)) {
    const auto result = results.find(row.evaluation);
    if (result == results.end()) {
      if (marks.contains({row.submission, kHidden})) continue;
      return absl::UnavailableError(absl::StrCat("the receipt of evaluation ", row.evaluation,
                                                 " is withheld and may have a row there"));
    }
    if (!result->second.done) continue;
    row.artefact_name = result->second.name;
    row.aggregate = result->second.aggregate;
    standings.push_back(std::move(row));
  }
  return standings;
}

}  // namespace

absl::StatusOr<RecordedConfig> ReadRecordedConfig(const Json& config) {
  const scoring::ScoredTrack* track =
      config.is_object() ? scoring::FindScoredTrack(TextAt(config, "track")) : nullptr;
  if (track == nullptr || !config.value("scoring", Json()).is_object()) {
    return absl::InvalidArgumentError("it is not a track config");
  }
  absl::StatusOr<scoring::TrackScoring> scoring = track->parse(config["scoring"], "scoring");
  if (!scoring.ok()) return absl::InvalidArgumentError(scoring.status().message());
  return RecordedConfig{config, *std::move(scoring)};
}

absl::StatusOr<ReceivedResult> ResultOfReceipt(const Json& receipt) {
  const scoring::ScoredTrack* track = scoring::FindScoredTrack(TextAt(receipt, "track_kind"));
  if (track == nullptr) return absl::InvalidArgumentError("its track is not known to this program");
  std::vector<EpisodeRow> rows;
  for (const Json& entry : receipt["episodes"]) {
    ASSIGN_OR_RETURN(EpisodeRow row, RowOfEntry(entry));
    rows.push_back(std::move(row));
  }
  const absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(*track, rows);
  if (!aggregate.ok()) {
    return absl::InvalidArgumentError("its episodes yield no numbers");
  }
  Json numbers = AggregateToJson(*track, *aggregate);
  const Json said = receipt.value("aggregate", Json());
  TakeNumbersOfFacts(*track, said, numbers);
  const bool done = TextAt(receipt, "state") == "done";
  if (numbers != said || done == aggregate->failed) {
    return absl::InvalidArgumentError(
        "its numbers do not follow from its episodes");
  }
  return ReceivedResult{.done = done,
                        .hides_seeds = HidesSeeds(receipt),
                        .name = TextAt(receipt, "name"),
                        .aggregate = std::move(numbers)};
}

absl::StatusOr<std::string> BoardText(const BoardState& record,
                                      const std::map<int64_t, ReceivedResult>& results,
                                      const std::string& hash, const RecordedConfig& config,
                                      const std::string& board) {
  const auto spec = config.scoring.boards.find(board);
  if (spec == config.scoring.boards.end()) {
    return absl::InvalidArgumentError("its config has no board of this name");
  }
  const Marks marks = record.MarksAt();
  ASSIGN_OR_RETURN(const std::vector<StandingRow> standings,
                   ListStandings(record, marks, results, hash));
  ASSIGN_OR_RETURN(const Leaderboard made,
                   MakeLeaderboard(standings, marks, spec->second.rules, config.scoring));
  const Json rules = config.config["scoring"].value("boards", Json::object());
  Json answer = BoardToJson(made);
  answer.update({{"board", board},
                 {"config", hash},
                 {"phase", TextOrNull(TextAt(config.config, "phase"))},
                 {"track", TextAt(config.config, "id")},
                 {"profile", TextAt(config.config, "profile")},
                 {"rules", rules.value(board, Json::object())},
                 {"official_figures", config.scoring.official_figures}});
  return CanonicalJson(RecordedBoard(answer)) + "\n";
}

std::string FirstDifference(const std::string& found, const std::string& expected) {
  const absl::StatusOr<Json> board = ParseJson(found, "the board");
  if (!board.ok() || !board->is_object()) return "it is not a board";
  const Json differences = Json::diff(*board, Json::parse(expected));
  if (differences.empty()) return "it is not in its canonical form";
  const Json& first = differences.front();
  Json::json_pointer place(first["path"].get<std::string>());
  // What a list lacks at its end has no number in a difference.
  if (const Json& list = board->at(place.parent_pointer()); list.is_array() && place.back() == "-") {
    place = place.parent_pointer() / list.size();
  }
  const auto shown = [](const Json& value) { return value.dump().substr(0, 80); };
  return Sanitized(absl::StrCat(
      "its ", place.to_string(), " is ",
      board->contains(place) ? shown(board->at(place)) : "missing", ", but by the record it is ",
      first.contains("value") ? shown(first["value"]) : "not there"));
}

}  // namespace myograde::server
