// Runs a program to its end: text in, bytes out, a deadline.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

namespace myograde::server {

struct ProgramOrder {
  std::string program;                  // its path, or the name of one beside this program
  std::vector<std::string> words = {};  // its arguments
  std::string input = {};               // for its standard input
  size_t most_output = 0;               // bytes of its standard output that are taken
  absl::Duration deadline = absl::Minutes(10);
  int nice = 19;
  std::vector<std::string> environment = {};  // as of SpawnOrder
};

struct ProgramEnd {
  int exit_status = 0;  // 128 + N: signal N ended it
  std::string output;
  std::string errors;   // the end of its standard error, as valid UTF-8

  std::string HowItEnded() const;  // "exited with status 2", "was killed by signal 11"
  std::string LastError() const;   // the last line of `errors`; "" if there is none
};

// Of a program that failed: the last line of its errors, or how it ended, or why it was not run.
std::string WhyItFailed(const absl::StatusOr<ProgramEnd>& end);

// CancelledError as soon as `stopped` (asked ten times a second), DeadlineExceededError,
// ResourceExhaustedError if it prints more than it may: it and what it started are dead on return.
// InternalError: it can't be started.
absl::StatusOr<ProgramEnd> RunProgram(
    const ProgramOrder& order, const std::function<bool()>& stopped = [] { return false; });

}  // namespace myograde::server
