// What the store keeps of an evaluation, read as a whole: all that playing and ranking it needs.
// Whatever of it can't be read is a damaged row (store/damage.h).
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

using SeedsPtr = std::shared_ptr<const std::vector<uint64_t>>;

// A config as an accepted submission was made under, whatever its form.
absl::StatusOr<TrackConfig> StoredConfig(Reader& reader, const std::string& hash);

// The same as a track. A config that scoring can't read is a damaged row too.
absl::StatusOr<TrackPtr> StoredTrack(Reader& reader, const std::string& hash);

// Configs and seed lists that were read, as thousands of evaluations share few. For one thread.
class StoredContent {
 public:
  absl::StatusOr<TrackPtr> Track(Reader& reader, const std::string& hash);
  absl::StatusOr<SeedsPtr> Seeds(Reader& reader, const std::string& hash);

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
  std::vector<LeaseRow> leases;  // one after the other, from its first episode to its last
};
absl::StatusOr<StoredEvaluation> LoadEvaluation(Reader& reader, int64_t evaluation,
                                                StoredContent& content);

// The rows of an evaluation whose leases are all done: one of each episode, with its seed.
absl::StatusOr<std::vector<EpisodeRow>> WholeEpisodes(Reader& reader,
                                                      const EvaluationRow& evaluation,
                                                      const std::vector<uint64_t>& seeds);

// The folder of an artefact's files, and whether they are there: NotFoundError if they were
// removed, or the artefact came with an import.
std::string ArtefactFolder(const std::string& data_dir, const std::string& hash);
absl::Status HasArtefactFiles(const std::string& data_dir, const std::string& hash);

}  // namespace myograde::server
