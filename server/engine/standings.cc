#include "server/engine/standings.h"

#include <absl/strings/str_cat.h>

#include "server/grading/results.h"
#include "server/engine/stored.h"

namespace myograde::server {

absl::StatusOr<Standing> ReadStanding(Reader& reader, int64_t evaluation) {
  absl::StatusOr<EvaluationRow> row = reader.Evaluation(evaluation);
  if (!row.ok()) return row.status();
  absl::StatusOr<SubmissionRow> submission = reader.Submission(row->submission);
  if (absl::IsNotFound(submission.status())) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation),
                       std::string(submission.status().message())});
  }
  if (!submission.ok()) return submission.status();
  absl::StatusOr<TrackConfig> config = StoredConfig(reader, ConfigOf(*row, *submission));
  if (!config.ok()) return config.status();
  absl::StatusOr<std::vector<EpisodeRow>> rows = reader.Episodes(evaluation);
  if (!rows.ok()) return rows.status();
  if (std::ssize(*rows) != row->last - row->first + 1) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation),
                       absl::StrCat("it is done, and has ", rows->size(), " of its ",
                                    row->last - row->first + 1, " episodes")});
  }
  const scoring::ScoredTrack& track = *scoring::FindScoredTrack(config->kind->name);
  const absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(track, *rows);
  if (!aggregate.ok()) return aggregate.status();
  if (absl::Status whole = CheckResults(reader, *row, *rows, config->seed_salt); !whole.ok()) {
    return whole;
  }
  return StandingOf(track, *aggregate);
}

absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only) {
  Standings standings;
  const absl::Status status = readers.Read([&](Reader& reader) -> absl::Status {
    for (const int64_t evaluation : reader.DoneEvaluations(missing_only)) {
      absl::StatusOr<Standing> standing = ReadStanding(reader, evaluation);
      if (standing.ok()) {
        standings.rows.emplace_back(evaluation, *std::move(standing));
      } else if (const std::optional<Damage> damage = DamageOf(standing.status())) {
        standings.damaged.push_back(*damage);
      } else {
        return standing.status();
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return standings;
}

absl::StatusOr<std::vector<Damage>> FillStandings(Store& store, ReaderPool& readers) {
  absl::StatusOr<Standings> missing = MakeStandings(readers, /*missing_only=*/true);
  if (!missing.ok()) return missing.status();
  if (missing->rows.empty()) return std::move(missing->damaged);
  const absl::Status status = store.Write([&](Writer& writer) {
    for (const auto& [id, standing] : missing->rows) {
      const absl::Status set = writer.Part([evaluation = id, &numbers = standing](Writer& part) {
        return part.SetStanding(evaluation, numbers);
      });
      if (!set.ok()) {
        missing->damaged.push_back({"evaluation", absl::StrCat(id),
                                    std::string(set.message())});
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return std::move(missing->damaged);
}

}  // namespace myograde::server
