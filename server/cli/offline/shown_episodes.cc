#include "server/cli/offline/shown_episodes.h"

#include <absl/strings/str_cat.h>

#include <optional>
#include <string_view>
#include <utility>

#include "protocol/base/outcome.h"
#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "protocol/tracks/registry.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/play_logs.h"
#include "server/cli/terminal/text.h"
#include "server/grading/leaderboard.h"
#include "server/grading/results.h"
#include "server/grading/tracks.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

// "failure: dropped"; "" where the phase withholds it.
std::string RowVerdict(const Json& row) {
  const std::string outcome = TextAt(row, "outcome");
  const std::string reason = TextAt(row, "reason");
  return reason.empty() ? outcome : absl::StrCat(outcome, ": ", reason);
}

absl::Status CheckHasSteps(const EpisodeLog& log) {
  if (log.steps() > 0) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("episode ", log.header.episode,
                                          " has no step to show: it ended by \"", log.end.end,
                                          "\" before the first"));
}

bool CanBeShown(const Json& row) {
  const Json log = row.value("log", Json());
  return log.is_object() && log.value("steps", int64_t{0}) > 0 && TextAt(row, "end") != kPhantom;
}

// What scoring reads of a row, from what the API shows of it; nullopt if the phase withholds that.
std::optional<EpisodeRow> StoredForm(const Json& row, std::string_view track) {
  const std::optional<Outcome> outcome = ParseOutcome(TextAt(row, "outcome"));
  const std::optional<FailureReason> reason = ParseFailureReason(TextAt(row, "reason"));
  if (!outcome.has_value() || !reason.has_value() || !row.value("metrics", Json()).is_object()) {
    return std::nullopt;
  }
  EpisodeRow stored;
  stored.index = row.value("index", int64_t{0});
  stored.outcome = *outcome;
  stored.reason = *reason;
  stored.metrics_json = row["metrics"].dump();
  const Json facts = {{"steps", row.value("steps", Json())},
                      {std::string(track), row.value("facts", Json())}};
  stored.facts_json = facts.dump();
  return stored;
}

absl::StatusOr<std::vector<int64_t>> OrderOf(const std::vector<Json>& rows,
                                             const TrackConfig& config) {
  ASSIGN_OR_RETURN(const TrackPtr track, MakeTrack(config));
  std::vector<EpisodeRow> stored;
  for (const Json& row : rows) {
    std::optional<EpisodeRow> form = StoredForm(row, config.kind->name);
    if (!form.has_value()) {
      return absl::FailedPreconditionError(absl::StrCat(
          "the phase withholds the results of the episodes, so none of them is known to be the "
          "best; show one with --episode"));
    }
    stored.push_back(*std::move(form));
  }
  ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*track->scoring.track, stored));
  return EpisodesInOrder(track->scoring, judged);
}

}  // namespace

absl::StatusOr<ShownEpisodes> EpisodeOfFile(const std::string& path) {
  ASSIGN_OR_RETURN(EpisodeLog log, ParseLog(ReadLog(path)));
  RETURN_IF_ERROR(CheckHasSteps(log));
  ShownEpisode shown = {.index = log.header.episode, .place = "", .order = {},
                        .steps = log.steps()};
  ASSIGN_OR_RETURN(const auto files, LogsUpTo(path, log.header));
  for (const auto& [episode, file] : files) shown.order.logs.push_back(file.path);
  return ShownEpisodes{std::move(log.header.track), {std::move(shown)}};
}

absl::StatusOr<ShownEpisodes> EpisodeOfEvaluation(const Client& client, const Json& evaluation,
                                                  int64_t index, const std::string& folder) {
  ASSIGN_OR_RETURN(FetchedLog own, FetchLog(client, evaluation, index, folder));
  RETURN_IF_ERROR(CheckHasSteps(own.log));
  ShownEpisode shown = {.index = index, .place = "", .order = {}, .steps = own.log.steps()};
  TrackConfig& track = own.log.header.track;
  if (CarriesOver(track)) {
    for (int64_t before = FirstOfLease(track, index); before < index; ++before) {
      ASSIGN_OR_RETURN(const FetchedLog log, FetchLog(client, evaluation, before, folder));
      shown.order.logs.push_back(log.file.path);
    }
  }
  shown.order.logs.push_back(own.file.path);
  shown.order.verdict = RowVerdict(*RowOf(evaluation, index));
  return ShownEpisodes{std::move(track), {std::move(shown)}};
}

absl::StatusOr<ShownEpisodes> StripOfEvaluation(const Client& client, const Json& evaluation,
                                                const std::string& folder) {
  std::vector<Json> rows;
  for (const Json& row : evaluation["episode_rows"]) {
    if (CanBeShown(row)) rows.push_back(row);
  }
  if (rows.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "submission ", evaluation.value("submission", 0), " has no episode with a log to show"));
  }
  // A log has the config, and with it the board's rules.
  ASSIGN_OR_RETURN(const FetchedLog any,
                   FetchLog(client, evaluation, rows.front().value("index", int64_t{-1}), folder));
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, OrderOf(rows, any.log.header.track));
  ShownEpisodes strip;
  strip.track = any.log.header.track;
  for (const PickedEpisode& picked : BestMedianWorst(order)) {
    ASSIGN_OR_RETURN(ShownEpisodes fetched,
                     EpisodeOfEvaluation(client, evaluation, picked.index, folder));
    ShownEpisode& shown = fetched.episodes.front();
    shown.place = picked.place;
    shown.order.title = absl::StrCat(std::string(picked.place), ": episode ", picked.index);
    strip.episodes.push_back(std::move(shown));
  }
  return strip;
}

}  // namespace myograde::server
