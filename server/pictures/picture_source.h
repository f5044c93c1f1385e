// Finds in the store what pictures are made of.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/pictures/makers.h"
#include "server/pictures/pictures.h"
#include "server/store/reader.h"

namespace myograde::server {

// 16 hexadecimal digits that change with the programs that make pictures.
std::string PictureBuild(const std::string& cache_dir);

// The episode of a log, with what it can't be played without. NotFoundError: no episode has the log, or
// one of the files is not there any more. A damaged row (store/damage.h).
absl::StatusOr<PicturedEpisode> EpisodeToShow(ReaderPool& readers, const std::string& data_dir,
                                           const std::string& log);

// Makes what the key says, of the store's episodes. Errors: of EpisodeToShow and of the makers.
absl::StatusOr<std::string> MakeFile(ReaderPool& readers, const std::string& data_dir,
                                     const MakerOptions& makers, const PictureKey& key,
                                     const Stopped& stopped);

// Tells of the best, the median and the worst episode of each evaluation that ended since the last
// call, or since this object was made. Not safe from several threads.
class EndedEvaluations {
 public:
  // `readers` must outlive it.
  explicit EndedEvaluations(ReaderPool& readers);

  // Of the 20 that ended last.
  std::vector<PictureKey> Pictures();

 private:
  ReaderPool& readers_;
  int64_t seen_ = 0;  // ms since 1970: when the last one that was seen ended
};

}  // namespace myograde::server
