// Programs that are run to their end, and what they print.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

namespace myograde::server {

struct CapturedRun {
  bool good = false;  // it exited with status 0
  std::string ended;  // in words: "exited with status 2", "was killed by signal 11"
  std::string out;
  std::string error;  // the last line of its standard error
};

// Starts the program words[0] at low priority with `in` as its standard input, and waits for its
// end. CancelledError if a stop is requested meanwhile (stop_signal.h), DeadlineExceededError after
// `timeout`, ResourceExhaustedError if it prints more than `most_bytes`; its process group is dead
// then. InternalError if it can't be started.
absl::StatusOr<CapturedRun> RunCaptured(std::vector<std::string> words, std::string_view in,
                                        absl::Duration timeout, size_t most_bytes);

}  // namespace myograde::server
