// All that the store keeps of an evaluation and that playing and ranking it needs, and what boards
// are ranked by, computed from it. Anything unreadable is a damaged row (store/damage.h).
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/grading/tracks.h"
#include "server/store/store.h"

namespace myograde::server {

using SeedsPtr = std::shared_ptr<const std::vector<uint64_t>>;

// The seeds that the store has under a hash, by index of the episodes.
absl::StatusOr<std::vector<uint64_t>> StoredSeeds(const Transaction& reader,
                                                  const std::string& hash);

// Caches configs and seed lists, as thousands of evaluations share a few. Not thread-safe.
class StoredContent {
 public:
  absl::StatusOr<TrackPtr> Track(const Transaction& reader, const std::string& hash);
  absl::StatusOr<SeedsPtr> Seeds(const Transaction& reader, const std::string& hash);

 private:
  std::map<std::string, TrackPtr> tracks_;
  std::map<std::string, std::weak_ptr<const std::vector<uint64_t>>> seeds_;
};

struct StoredEvaluation {
  EvaluationRow evaluation;
  SubmissionRow submission;
  ArtefactRow artefact;
  TrackPtr track;
  SeedsPtr seeds;
  std::vector<BlockRow> blocks;  // contiguous, from the first episode to the last
};
absl::StatusOr<StoredEvaluation> LoadEvaluation(const Transaction& reader, int64_t evaluation,
                                                StoredContent& content);

// The rows of an evaluation whose blocks are all done: one per episode, with its seed.
absl::StatusOr<std::vector<EpisodeRow>> WholeEpisodes(const Transaction& reader,
                                                      const EvaluationRow& evaluation,
                                                      const std::vector<uint64_t>& seeds);

// Whether the rows of an evaluation that ended with a result are those whose hash was kept then, in its
// own row and, if it has an entry, in the public record. Otherwise a damaged row that names the
// evaluation: the rows were changed since, and nothing that follows from them may be shown or signed.
// `seed_salt`: of the config that it ran under.
absl::Status CheckResults(const Transaction& reader, const EvaluationRow& evaluation,
                          const std::vector<EpisodeRow>& rows, const std::string& seed_salt);

// What an evaluation is ranked by (AggregateToJson), from its episode rows. The store caches it as a
// view, so that a board need not read every episode; it can be rebuilt at any time.
absl::StatusOr<nlohmann::json> ReadStanding(const Transaction& reader, int64_t evaluation);

// By evaluation: all that are done, or only those missing from the view.
struct Standings {
  std::vector<std::pair<int64_t, nlohmann::json>> rows;
  std::vector<Damage> damaged;  // of those that can't be read
};
absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only);

// Adds what the view lacks, as after an import. Returns what could not be read.
absl::StatusOr<std::vector<Damage>> FillStandings(Store& store, ReaderPool& readers);

// The first and last episodes of an evaluation's blocks: [0, count) cut at multiples of
// `per_lease`.
std::vector<std::pair<int64_t, int64_t>> SplitIntoBlocks(int64_t count, int64_t per_lease);

// Whether every row of the store can be read, by the readers that requests and the engine use, and
// results are those of their episodes: for rows that come from outside. The first damaged row otherwise (store/damage.h).
absl::Status CheckReadable(const Transaction& reader);

// The folder of an artefact's files. NotFoundError if the files were removed, or the artefact came
// with an import.
std::string ArtefactFolder(const std::string& data_dir, const std::string& hash);
// The folder of files that images share (server/artefact/share_files.h).
std::string SharedFolder(const std::string& data_dir);
absl::Status HasArtefactFiles(const std::string& data_dir, const std::string& hash);

}  // namespace myograde::server
