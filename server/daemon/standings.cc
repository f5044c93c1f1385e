#include "server/daemon/standings.h"

#include <absl/strings/str_cat.h>

#include "protocol/config_reader.h"
#include "server/daemon/results.h"

namespace myograde::server {

absl::StatusOr<std::string> StandingText(TrackKind kind, const std::vector<EpisodeRow>& rows) {
  absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(rows);
  if (!aggregate.ok()) return aggregate.status();
  return CanonicalJson(AggregateToJson(kind, *aggregate));
}

absl::StatusOr<std::string> StandingOf(Reader& reader, int64_t evaluation) {
  absl::StatusOr<EvaluationRow> row = reader.Evaluation(evaluation);
  if (!row.ok()) return row.status();
  absl::StatusOr<SubmissionRow> submission = reader.Submission(row->submission);
  if (!submission.ok()) return submission.status();
  absl::StatusOr<std::string> text = reader.ConfigJson(submission->config);
  if (!text.ok()) return text.status();
  absl::StatusOr<nlohmann::json> config = ParseJson(*text, "the store's config");
  if (!config.ok()) return config.status();
  const bool locomotion =
      config->is_object() && config->value("track", nlohmann::json()) == "locomotion";
  return StandingText(locomotion ? TrackKind::kLocomotion : TrackKind::kManipulation,
                      reader.Episodes(evaluation));
}

absl::StatusOr<std::vector<std::pair<int64_t, std::string>>> MakeStandings(ReaderPool& readers,
                                                                           bool missing_only) {
  std::vector<std::pair<int64_t, std::string>> standings;
  const absl::Status status = readers.Read([&](Reader& reader) -> absl::Status {
    for (const int64_t evaluation : reader.DoneEvaluations(missing_only)) {
      absl::StatusOr<std::string> standing = StandingOf(reader, evaluation);
      if (!standing.ok()) return standing.status();
      standings.emplace_back(evaluation, *std::move(standing));
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return standings;
}

absl::Status FillStandings(Store& store, ReaderPool& readers) {
  const auto missing = MakeStandings(readers, /*missing_only=*/true);
  if (!missing.ok() || missing->empty()) return missing.status();
  return store.Write([&](Writer& writer) {
    absl::Status status;
    for (const auto& [evaluation, standing] : *missing) {
      status.Update(writer.SetStanding(evaluation, standing));
    }
    return status;
  });
}

}  // namespace myograde::server
