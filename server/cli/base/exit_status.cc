#include "server/cli/base/exit_status.h"

#include <signal.h>

#include <absl/strings/str_cat.h>

#include "server/cli/terminal/screen.h"

namespace myograde::server {
namespace {

volatile sig_atomic_t g_stop_requested = 0;

}  // namespace

int ExitOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kDone;
    case absl::StatusCode::kUnavailable:
      return kUnreachable;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return kWrongUse;
    default:
      return kTrouble;
  }
}

int ReportError(const absl::Status& status) {
  PrintToErrors(absl::StrCat("myograde: error: ", status.message()));
  return ExitOf(status);
}

absl::Status HostStatus(std::string_view what, const absl::Status& status) {
  if (status.ok()) return status;
  const int exit = ExitOf(status);
  const absl::StatusCode code =
      exit == kWrongUse ? status.code() : absl::StatusCode::kInternal;
  return absl::Status(code, absl::StrCat(absl::string_view(what.data(), what.size()),
                                         what.empty() ? "" : ": ", status.message()));
}

absl::StatusOr<int> ExitOfLogError(const absl::Status& status) {
  if (!absl::IsDataLoss(status)) return status;
  ReportError(status);
  return kNoScore;
}

void CatchStopSignals() {
  struct sigaction action = {};
  action.sa_handler = [](int) { g_stop_requested = 1; };  // no SA_RESTART, so that poll returns
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

bool StopRequested() { return g_stop_requested != 0; }

}  // namespace myograde::server
