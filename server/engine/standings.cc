#include "server/engine/standings.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/grading/results.h"
#include "server/engine/stored.h"

namespace myograde::server {

absl::StatusOr<Standing> ReadStanding(Reader& reader, int64_t evaluation) {
  ASSIGN_OR_RETURN(EvaluationRow row, reader.Evaluation(evaluation));
  absl::StatusOr<SubmissionRow> submission = reader.Submission(row.submission);
  if (absl::IsNotFound(submission.status())) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation),
                       std::string(submission.status().message())});
  }
  if (!submission.ok()) return submission.status();
  ASSIGN_OR_RETURN(TrackConfig config, StoredConfig(reader, ConfigOf(row, *submission)));
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.Episodes(evaluation));
  if (std::ssize(rows) != row.last - row.first + 1) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation),
                       absl::StrCat("it is done, and has ", rows.size(), " of its ",
                                    row.last - row.first + 1, " episodes")});
  }
  const scoring::ScoredTrack& track = *scoring::FindScoredTrack(config.kind->name);
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate, AggregateRows(track, rows));
  RETURN_IF_ERROR(CheckResults(reader, row, rows, config.seed_salt));
  return StandingOf(track, aggregate);
}

absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only) {
  Standings standings;
  RETURN_IF_ERROR(readers.Read([&](Reader& reader) -> absl::Status {
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
  }));
  return standings;
}

absl::StatusOr<std::vector<Damage>> FillStandings(Store& store, ReaderPool& readers) {
  ASSIGN_OR_RETURN(Standings missing, MakeStandings(readers, /*missing_only=*/true));
  if (missing.rows.empty()) return std::move(missing.damaged);
  RETURN_IF_ERROR(store.Write([&](Writer& writer) {
    for (const auto& [id, standing] : missing.rows) {
      const absl::Status set = writer.Part([evaluation = id, &numbers = standing](Writer& part) {
        return part.SetStanding(evaluation, numbers);
      });
      if (!set.ok()) {
        missing.damaged.push_back({"evaluation", absl::StrCat(id),
                                    std::string(set.message())});
      }
    }
    return absl::OkStatus();
  }));
  return std::move(missing.damaged);
}

}  // namespace myograde::server
