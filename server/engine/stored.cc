#include "server/engine/stored.h"

#include <algorithm>
#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "scoring/aggregate_json.h"
#include "server/base/json_value.h"
#include "server/grading/results.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

constexpr size_t kSeedListsKept = 64;

absl::Status Unreadable(const char* table, const std::string& key, const absl::Status& why) {
  return DamagedRow({table, key, std::string(why.message())});
}

// The submission of an evaluation. If its row is missing, then the evaluation's is damaged.
absl::StatusOr<SubmissionRow> FindSubmission(const Transaction& reader,
                                             const EvaluationRow& evaluation) {
  absl::StatusOr<SubmissionRow> submission = reader.submissions.Find(evaluation.submission);
  if (absl::IsNotFound(submission.status())) {
    return Unreadable("evaluation", absl::StrCat(evaluation.id), submission.status());
  }
  return submission;
}

// Whether a list left nothing out.
template <typename Row>
absl::Status StatusOfList(const Listed<Row>& list) {
  return list.damaged.empty() ? absl::OkStatus() : DamagedRow(list.damaged.front());
}

// An evaluation with all that belongs to it.
absl::Status CheckEvaluation(const Transaction& reader, int64_t id, StoredContent& content) {
  ASSIGN_OR_RETURN(const StoredEvaluation stored, LoadEvaluation(reader, id, content));
  absl::StatusOr<std::vector<EpisodeRow>> rows = reader.episodes.Of(id);
  if (rows.ok() && stored.evaluation.state == EvaluationState::kDone) {
    rows = WholeEpisodes(reader, stored.evaluation, *stored.seeds);
  }
  if (!rows.ok()) return rows.status();
  RETURN_IF_ERROR(JudgedEpisodes(*stored.track->scoring.track, *rows).status());
  RETURN_IF_ERROR(CheckResults(reader, stored.evaluation, *rows, stored.track->config.seed_salt));
  RETURN_IF_ERROR(reader.episodes.Details(id).status());
  RETURN_IF_ERROR(reader.episodes.Repeats(id).status());
  RETURN_IF_ERROR(reader.blocks.ListAttempts(id).status());
  return reader.evaluations.Transitions("evaluation", id).status();
}

absl::Status CheckTeams(const Transaction& reader) {
  const Listed<TeamRow> teams = reader.teams.List();
  RETURN_IF_ERROR(StatusOfList(teams));
  for (const TeamRow& team : teams.rows) {
    RETURN_IF_ERROR(StatusOfList(reader.teams.Members(team.name)));
    RETURN_IF_ERROR(StatusOfList(reader.quotas.Ledger(team.name, "", INT64_MAX, INT64_MAX)));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<uint64_t>> StoredSeeds(const Transaction& reader,
                                                  const std::string& hash) {
  ASSIGN_OR_RETURN(const std::string text, reader.content.Text(kSeedLists, hash));
  auto seeds = ParseSeeds(ParsedText(text), "its content");
  return seeds.ok() ? std::move(seeds) : Unreadable(kSeedLists, hash, seeds.status());
}

absl::StatusOr<TrackPtr> StoredContent::Track(const Transaction& reader, const std::string& hash) {
  if (const auto it = tracks_.find(hash); it != tracks_.end()) return it->second;
  ASSIGN_OR_RETURN(TrackPtr track, StoredTrack(reader, hash));
  tracks_[hash] = track;
  return track;
}

absl::StatusOr<SeedsPtr> StoredContent::Seeds(const Transaction& reader, const std::string& hash) {
  if (SeedsPtr known = seeds_[hash].lock()) return known;
  if (seeds_.size() > kSeedListsKept) {
    std::erase_if(seeds_, [](const auto& entry) { return entry.second.expired(); });
  }
  ASSIGN_OR_RETURN(std::vector<uint64_t> list, StoredSeeds(reader, hash));
  const auto seeds = std::make_shared<const std::vector<uint64_t>>(std::move(list));
  seeds_[hash] = seeds;
  return seeds;
}

absl::StatusOr<StoredEvaluation> LoadEvaluation(const Transaction& reader, int64_t id,
                                                StoredContent& content) {
  StoredEvaluation stored;
  ASSIGN_OR_RETURN(stored.evaluation, reader.evaluations.Find(id));
  const std::string key = absl::StrCat(id);
  ASSIGN_OR_RETURN(stored.submission, FindSubmission(reader, stored.evaluation));
  ASSIGN_OR_RETURN(stored.artefact, reader.content.Artefact(stored.submission.artefact));
  ASSIGN_OR_RETURN(stored.track, content.Track(reader, stored.evaluation.config));
  ASSIGN_OR_RETURN(stored.seeds, content.Seeds(reader, stored.evaluation.seeds));
  if (stored.evaluation.last >= static_cast<int64_t>(stored.seeds->size())) {
    return DamagedRow({"evaluation", key, absl::StrCat("it ends with episode ",
                                                       stored.evaluation.last, ", and there are ",
                                                       stored.seeds->size(), " seeds")});
  }
  ASSIGN_OR_RETURN(stored.blocks, reader.blocks.Of(id));
  int64_t next = stored.evaluation.first;
  for (const BlockRow& block : stored.blocks) {
    if (block.first != next) break;
    next = block.last + 1;
  }
  if (next != stored.evaluation.last + 1) {
    return DamagedRow(
        {"evaluation", key, absl::StrCat("no block of it holds episode ", next, ", or two do")});
  }
  return stored;
}

absl::StatusOr<std::vector<EpisodeRow>> WholeEpisodes(const Transaction& reader,
                                                      const EvaluationRow& evaluation,
                                                      const std::vector<uint64_t>& seeds) {
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.episodes.Of(evaluation.id));
  int64_t next = evaluation.first;
  for (const EpisodeRow& row : rows) {
    if (row.index != next) break;
    if (row.seed != seeds.at(static_cast<size_t>(next))) {
      return DamagedRow({"episode", absl::StrCat(evaluation.id, "/", next),
                         // The seed may be one that nobody may know yet, and this text is shown.
                         "its seed is not that of the seed list"});
    }
    ++next;
  }
  if (next != evaluation.last + 1 || std::ssize(rows) != evaluation.last - evaluation.first + 1) {
    return DamagedRow({"episode", absl::StrCat(evaluation.id, "/", next),
                       "it is missing, though its block is done"});
  }
  return rows;
}

absl::Status CheckResults(const Transaction& reader, const EvaluationRow& evaluation,
                          const std::vector<EpisodeRow>& rows, const std::string& seed_salt) {
  if (evaluation.state != EvaluationState::kDone && evaluation.state != EvaluationState::kFailed) {
    return absl::OkStatus();
  }
  const std::string hash = ResultsHash(rows, seed_salt);
  const auto damaged = [&](const char* where) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation.id),
                       absl::StrCat("its episodes are not those that it ended with: their hash is not "
                                    "that in ", where)});
  };
  if (!evaluation.results_hash.empty() && evaluation.results_hash != hash) {
    return damaged("its \"results_hash\"");
  }
  const absl::StatusOr<RecordRow> entry = reader.journal.GradedEntry(evaluation.id);
  if (!entry.ok()) return absl::OkStatus();  // practice has none; the check of the record's chain tells
  const nlohmann::json recorded = ParsedText(entry->entry_json).value("results", nlohmann::json());
  return !recorded.is_string() || recorded == hash ? absl::OkStatus() : damaged("the public record");
}

absl::Status CheckReadable(const Transaction& reader) {
  StoredContent content;
  for (const std::string& hash : reader.content.Hashes("artefact")) {
    RETURN_IF_ERROR(reader.content.Artefact(hash).status());
  }
  for (const std::string& hash : reader.content.Hashes(kConfigs)) {
    RETURN_IF_ERROR(content.Track(reader, hash).status());
  }
  for (const std::string& hash : reader.content.Hashes(kSeedLists)) {
    RETURN_IF_ERROR(content.Seeds(reader, hash).status());
  }
  RETURN_IF_ERROR(CheckTeams(reader));
  const Listed<SubmissionRow> submissions = reader.submissions.List({.limit = INT64_MAX});
  RETURN_IF_ERROR(StatusOfList(submissions));
  for (const SubmissionRow& submission : submissions.rows) {
    RETURN_IF_ERROR(reader.evaluations.Transitions("submission", submission.id).status());
    ASSIGN_OR_RETURN(const std::vector<EvaluationRow> evaluations,
                     reader.evaluations.Of(submission.id));
    for (const EvaluationRow& evaluation : evaluations) {
      RETURN_IF_ERROR(CheckEvaluation(reader, evaluation.id, content));
    }
  }
  for (const auto& [act, what] : reader.Board().damaged()) {
    return DamagedRow({"journal", absl::StrCat(act), what});
  }
  RETURN_IF_ERROR(StatusOfList(reader.blocks.DrainedNodes()));
  RETURN_IF_ERROR(StatusOfList(reader.journal.Record(0, reader.journal.RecordSize())));
  for (const auto& [id, rejudge] : reader.Board().rejudges()) {
    RETURN_IF_ERROR(reader.evaluations.OfRejudge(id).status());
  }
  return absl::OkStatus();
}

absl::StatusOr<nlohmann::json> ReadStanding(const Transaction& reader, int64_t evaluation) {
  ASSIGN_OR_RETURN(EvaluationRow row, reader.evaluations.Find(evaluation));
  RETURN_IF_ERROR(FindSubmission(reader, row).status());
  ASSIGN_OR_RETURN(const TrackPtr stored, StoredTrack(reader, row.config));
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.episodes.Of(evaluation));
  if (std::ssize(rows) != row.last - row.first + 1) {
    return DamagedRow({"evaluation", absl::StrCat(evaluation),
                       absl::StrCat("it is done, and has ", rows.size(), " of its ",
                                    row.last - row.first + 1, " episodes")});
  }
  const scoring::ScoredTrack& track = *stored->scoring.track;
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate, AggregateRows(track, rows));
  RETURN_IF_ERROR(CheckResults(reader, row, rows, stored->config.seed_salt));
  return AggregateToJson(track, aggregate);
}

absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only) {
  Standings standings;
  RETURN_IF_ERROR(readers.Read([&](const Transaction& reader) -> absl::Status {
    for (const int64_t evaluation : reader.evaluations.Done(missing_only)) {
      absl::StatusOr<nlohmann::json> standing = ReadStanding(reader, evaluation);
      if (standing.ok()) {
        standings.rows.emplace_back(evaluation, *std::move(standing));
      } else if (const std::optional<Damage> damage = ExtractDamage(standing.status())) {
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
  RETURN_IF_ERROR(store.Write([&](Transaction& writer) {
    for (const auto& [id, standing] : missing.rows) {
      const absl::Status set =
          writer.Part([evaluation = id, &aggregate = standing](Transaction& part) {
            return part.episodes.SetStanding(evaluation, aggregate);
          });
      if (!set.ok()) {
        missing.damaged.push_back({"evaluation", absl::StrCat(id), std::string(set.message())});
      }
    }
    return absl::OkStatus();
  }));
  return std::move(missing.damaged);
}

std::vector<std::pair<int64_t, int64_t>> SplitIntoBlocks(int64_t count, int64_t per_lease) {
  std::vector<std::pair<int64_t, int64_t>> blocks;
  for (int64_t first = 0; first < count; first += per_lease) {
    blocks.emplace_back(first, std::min(first + per_lease, count) - 1);
  }
  return blocks;
}

std::string ArtefactFolder(const std::string& data_dir, const std::string& hash) {
  return absl::StrCat(data_dir, "/artefacts/", hash);
}

std::string SharedFolder(const std::string& data_dir) { return data_dir + "/shared"; }

absl::Status HasArtefactFiles(const std::string& data_dir, const std::string& hash) {
  std::error_code error;
  if (std::filesystem::exists(ArtefactFolder(data_dir, hash), error)) return absl::OkStatus();
  return absl::NotFoundError(absl::StrCat("the files of artefact ", hash,
                                          " are no longer on this host; upload it again"));
}

}  // namespace myograde::server
