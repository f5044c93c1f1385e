// Does this host compute the same as every other? Plays the reference episodes, logs whose states
// are known, and compares. A daemon whose host fails grades no ranked submission.
#pragma once

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"

namespace myograde::server {

struct ReferenceOptions {
  std::string folder;      // of the logs: configs/reference
  std::string work_dir;    // created, and removed again
  std::string cache_dir;
  int64_t uid = -1;        // of the sandbox; -1: the caller's own
};

// Why ranked submissions of a track's environment (TrackKind::name) are refused whatever the host
// computes: no log of `folder` is of it. "": there is one.
std::string WhyUnreferenced(const std::string& folder, std::string_view kind);

// Plays every log of the folder, until `stop`. "" if all matched, else which did not and how. An
// error says why the check could not be made.
absl::StatusOr<std::string> PlayReference(const ReferenceOptions& options,
                                          const std::stop_token& stop);

// Runs PlayReference on its own thread, from construction to destruction.
class ReferenceCheck {
 public:
  explicit ReferenceCheck(ReferenceOptions options);

  // Waits for the verdict: nullopt if it is not known in time; "" if the host may grade ranked
  // submissions of the environment `kind`; else why not. A check that could not be made does not block
  // grading: whatever prevents it prevents leases as well.
  std::optional<std::string> Result(std::string_view kind, absl::Duration timeout) const;

 private:
  const ReferenceOptions options_;
  mutable Mutex mutex_;
  mutable Condition known_;
  std::optional<std::string> verdict_ ABSL_GUARDED_BY(mutex_);
  std::jthread thread_;
};

}  // namespace myograde::server
