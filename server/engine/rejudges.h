// Carries out rejudges: a thread that finds the items that open ones lack (at their creation, when an
// evaluation under from_config ends, and after a restart), computes those that follow from facts, and
// has the others queued. It writes a few items at a time through the engine, so that grading never
// waits long; stopping it at any moment loses nothing.
#pragma once

#include <string>
#include <thread>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "server/engine/engine.h"
#include "server/engine/stored.h"

namespace myograde::server {

struct RejudgerOptions {
  std::string data_dir;
  std::string cache_dir;                                 // for this host's build
  absl::Duration every = absl::Milliseconds(250);        // between looks for something new
};

class Rejudger {
 public:
  // Everything but `options` must outlive it. The engine must run.
  Rejudger(RejudgerOptions options, Engine& engine, ReaderPool& readers);
  ~Rejudger();

 private:
  void Loop();
  bool WaitForStop();
  bool stopping();

  const RejudgerOptions options_;
  Engine& engine_;
  ReaderPool& readers_;
  Mutex mutex_;
  Condition wake_;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace myograde::server
