// Does this host compute the same as every other? Plays the reference episodes, logs whose states
// are known, and compares. A daemon whose host fails grades no ranked submission.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "protocol/log/episode_log.h"

namespace myograde::server {

struct ReferenceOptions {
  std::string work_dir;    // created, and removed again
  std::string cache_dir;
  int64_t uid = -1;        // of the sandbox; -1: the caller's own
};

struct ReferenceHooks {
  std::function<std::string()> next;  // the environment whose logs come before others; "": any
  std::function<void(const std::string& kind)> matched;  // all logs of an environment did
};

// The logs of a folder, as they are when it is constructed.
class References {
 public:
  explicit References(std::string folder);

  // Why ranked submissions of an environment (TrackKind::name) are refused whatever the host computes:
  // no log is of it. "": there is one.
  std::string WhyLacking(std::string_view kind) const;
  // Plays every log, until `stop`. "" if all matched, else which did not and how. An error says why
  // the check could not be made.
  absl::StatusOr<std::string> Play(const ReferenceOptions& options, const std::stop_token& stop,
                                   const ReferenceHooks& hooks = {}) const;

 private:
  struct Log {
    std::string file;
    absl::StatusOr<LogHeader> header;

    bool IsOf(std::string_view kind) const {
      return header.ok() && header->track.kind->name == kind;
    }
  };
  std::string folder_;
  std::vector<Log> logs_;  // by name
};

// Plays them on its own thread, from construction to destruction: what is asked for at once, the rest
// at leisure.
class ReferenceCheck {
 public:
  // `folder`: of the logs, configs/reference.
  ReferenceCheck(std::string folder, ReferenceOptions options);

  // Waits for the verdict: nullopt if it is not known in time; "" if the host may grade ranked
  // submissions of the environment `kind`; else why not, which may be another environment's log. A
  // check that could not be made does not block grading: whatever prevents it prevents leases as well.
  std::optional<std::string> Result(std::string_view kind, absl::Duration timeout);
  const References& references() const { return references_; }

 private:
  std::string NextKind(const std::stop_token& stop);

  const ReferenceOptions options_;
  const References references_;
  Mutex mutex_;
  Condition changed_;
  std::set<std::string, std::less<>> asked_ ABSL_GUARDED_BY(mutex_);  // and not matched yet
  std::set<std::string, std::less<>> matched_ ABSL_GUARDED_BY(mutex_);
  std::optional<std::string> verdict_ ABSL_GUARDED_BY(mutex_);  // of all logs
  std::jthread thread_;
};

}  // namespace myograde::server
