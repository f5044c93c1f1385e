// Makes trajectories and pictures of episodes, one at a time, on a thread of its own: first those that
// somebody asked for, in their order, then, while no lease has run or waited for a while, those that
// somebody may ask for soon. What is made is kept as files (picture_files.h). A daemon that dies loses the queue, which
// is in memory only.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <thread>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/pictures/picture_files.h"

namespace myograde::server {

// Whether to give up what is being made.
using Stopped = std::function<bool()>;

struct PicturesOptions {
  std::string folder;          // must exist
  std::function<std::string()> build;  // of the programs: PictureBuild
  int64_t most_bytes = 0;      // of the folder
  // How a file is made (MakeFile, picture_source.h); tests have their own. Called on the thread.
  std::function<absl::StatusOr<std::string>(const PictureKey&, const Stopped&)> make;
  // Whether leases run or wait: nothing is made then that nobody asked for.
  std::function<bool()> grading;
  absl::Duration quiet = absl::Seconds(30);  // ... nor so soon after
  // What somebody may ask for soon, since it was last called. Called on the thread while nothing else
  // is to be done.
  std::function<std::vector<PictureKey>()> suggestions;
};

// What there is of a picture.
struct PictureState {
  // kMissing: what it is made of is not there (any more).
  enum class Is { kReady, kWaiting, kPlaying, kMissing, kFailed, kFull };
  Is is = Is::kFull;
  int64_t place = 0;  // kWaiting: how many are made before it
  std::string why;    // kFailed: one sentence
};

class Pictures {
 public:
  static constexpr size_t kMostWaiting = 100;
  static constexpr size_t kMostOfOne = 8;  // of these, of one caller

  explicit Pictures(PicturesOptions options, const Clock& clock = SystemClock());
  ~Pictures();
  Pictures(const Pictures&) = delete;
  Pictures& operator=(const Pictures&) = delete;

  // Safe from any thread. What is not there is queued for `who` ("": an organiser, who has no limit of
  // their own), unless it failed lately or the queue is full (kFull).
  PictureState Ask(const PictureKey& key, const std::string& who);

  const PictureFiles& files() const { return files_; }

  // Makes nothing more, and gives up what is being made. Never waits.
  void Stop();

 private:
  struct Job {
    PictureKey key;
    std::string who;
  };
  struct Failure {
    std::string why;       // "": what it is made of is not there
    absl::Duration again;  // when it is tried again, by the monotonic clock
  };

  // The next job, or nullopt when it is time to stop. Waits for one.
  std::optional<Job> Next() ABSL_LOCKS_EXCLUDED(mutex_);
  std::optional<Job> NextSuggested() ABSL_LOCKS_EXCLUDED(mutex_);
  void Make(const Job& job);
  void NoteFailure(const PictureKey& key, const absl::Status& why)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const PicturesOptions options_;
  const Clock& clock_;
  const PictureFiles files_;

  Mutex mutex_;
  Condition wake_;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Job> waiting_ ABSL_GUARDED_BY(mutex_);
  std::optional<PictureKey> playing_ ABSL_GUARDED_BY(mutex_);
  bool playing_was_asked_ ABSL_GUARDED_BY(mutex_) = false;
  std::map<PictureKey, Failure> failures_ ABSL_GUARDED_BY(mutex_);
  // Of the thread alone.
  std::deque<PictureKey> suggested_;
  absl::Duration busy_at_;  // when leases last ran or waited, as far as it looked
  std::thread thread_;
};

}  // namespace myograde::server
