// How a verb ends: exit statuses, how errors are reported, and stopping by Ctrl-C and the like.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <string_view>

namespace myograde::server {

// README.md lists them for users.
enum Exit : int {
  kDone = 0,         // a policy that scores 0 of 100 is done
  kNoScore = 1,      // ended without a score, or a difference was found
  kWrongUse = 2,     // arguments, files or ids that can't be used
  kUnreachable = 3,  // no daemon answers
  kTrouble = 4,      // the grader or its host
  kIncomplete = 5,   // nothing wrong was found, and not everything could be checked
};

// What a verb does once its arguments are parsed; returns the exit status, or an error to report.
using Action = std::function<absl::StatusOr<int>()>;

// Statuses of this tool's own functions: kUnavailable means that no daemon answers;
// InvalidArgument, NotFound, FailedPrecondition and OutOfRange are the user's to correct;
// everything else is trouble of the grader or its host.
int ExitOf(const absl::Status& status);

// Prints "myograde: error: ..." on standard error and returns ExitOf(status).
int ReportError(const absl::Status& status);

// A status of another part on this host: what is not the user's to correct becomes kInternal, as
// kUnavailable here means a silent daemon only. `what` goes in front.
absl::Status HostStatus(std::string_view what, const absl::Status& status);
template <typename T>
absl::StatusOr<T> HostStatus(std::string_view what, absl::StatusOr<T> result) {
  if (!result.ok()) return HostStatus(what, result.status());
  return result;
}

// Of a verb about a log: one that is damaged is no trouble of the host. That is reported, and
// kNoScore; any other error is returned.
absl::StatusOr<int> ExitOfLogError(const absl::Status& status);

// From now on SIGINT, SIGTERM and SIGHUP end no process but make StopRequested true; system calls
// that wait return early.
void CatchStopSignals();

bool StopRequested();

}  // namespace myograde::server
