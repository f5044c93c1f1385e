// Exit statuses of the command line tool, and how errors are reported.
#pragma once

#include <functional>
#include <string_view>

#include <absl/status/status.h>

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

// What a verb does once its arguments are parsed; returns the exit status.
using Action = std::function<int()>;

// Statuses of this tool's own functions: kUnavailable means that no daemon answers;
// InvalidArgument, NotFound, FailedPrecondition and OutOfRange are the user's to correct;
// everything else is trouble of the grader or its host.
int ExitOf(const absl::Status& status);

// Prints "myograde: error: ..." on standard error and returns ExitOf(status).
int ReportError(const absl::Status& status);

// A status of another part on this host: what is not the user's to correct becomes kInternal, as
// kUnavailable here means a silent daemon only. `what` goes in front.
absl::Status HostStatus(std::string_view what, const absl::Status& status);

}  // namespace myograde::server
