// Makes what viewers show of an episode: finds in the store what it is made of, and has it made by
// programs of the grader that keep a log's hostile bytes to themselves, at the lowest priority.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/pictures/pictures.h"
#include "server/store/store.h"

namespace myograde::server {

struct MakerOptions {
  std::string work_dir;  // made for each file and removed again
  std::string cache_dir;
  int64_t uid = -1;  // of the sandbox; -1: the caller's own
};

// 16 hexadecimal digits that change with the programs that make pictures.
std::string PictureBuild(const std::string& cache_dir);

// Makes what the key says, of the store's episodes: a trajectory file (sim/trajectory/README.md), a
// PNG of 320 by 180 pixels, or the model file of a track. NotFoundError: no episode has the log, or
// one of the files that it can't be played without is no longer there. DataLossError: the
// episode can't be shown, and trying again changes nothing. CancelledError: `stopped`. A damaged
// row (store/damage.h). Any other: the host is in trouble.
absl::StatusOr<std::string> MakeFile(ReaderPool& readers, const std::string& data_dir,
                                     const MakerOptions& makers, const PictureKey& key,
                                     const Stopped& stopped);

// Gives the pictures of the best, the median and the worst episode of each evaluation, of the 20
// that ended last, that ended since it was last called, or since this function was. Not safe from
// several threads. `readers` must outlive it.
std::function<std::vector<PictureKey>()> PicturesOfEnded(ReaderPool& readers);

}  // namespace myograde::server
