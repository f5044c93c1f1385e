#include "server/cli/client/follow.h"

#include <algorithm>

#include <absl/time/clock.h>

#include "protocol/base/clock.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/terminal/progress.h"

namespace myograde::server {
namespace {

// After a long wait the end need not be noticed at once, and each poll takes processor time from
// the policies that are graded.
constexpr absl::Duration kShortestPoll = absl::Milliseconds(250);
constexpr absl::Duration kLongestPoll = absl::Seconds(1);
constexpr int kPollsInAWait = 20;
constexpr absl::Duration kPatience = absl::Seconds(30);

std::string NoteOf(const nlohmann::json& status) {
  const nlohmann::json waiting = status.value("waiting", nlohmann::json());
  if (status.value("state", "") != "queued") return status.value("state", "");
  return waiting.is_string() ? "queued: " + waiting.get<std::string>() : "queued";
}

}  // namespace

bool IsFinalState(const std::string& state) { return state != "queued" && state != "running"; }

int ExitOfState(const std::string& state) {
  if (state == "done") return kDone;
  return state == "grader_error" ? kTrouble : kNoScore;
}

absl::StatusOr<nlohmann::json> Follow(const Client& client, const std::string& path,
                                      const std::string& what) {
  return FollowUntil(client, path, what, [](const nlohmann::json& status) {
    return IsFinalState(status.value("state", ""));
  });
}

absl::StatusOr<nlohmann::json> FollowUntil(
    const Client& client, const std::string& path, const std::string& what,
    const std::function<bool(const nlohmann::json&)>& final) {
  Progress progress(what);
  const Clock& clock = SystemClock();
  const absl::Duration start = clock.Monotonic();
  absl::Duration heard = start;
  for (;;) {
    absl::StatusOr<nlohmann::json> status = client.Get(path);
    if (status.ok()) {
      heard = clock.Monotonic();
      const nlohmann::json counts = status->value("episodes", nlohmann::json::object());
      const std::string state = status->value("state", "");
      const auto done = counts.value("done", int64_t{0});
      const auto total = counts.value("total", int64_t{0});
      if (state == "queued") {
        progress.ShowWaiting(done, total, NoteOf(*status));
      } else {
        progress.Show(done, total, NoteOf(*status));
      }
      if (final(*status)) return status;
    } else if (status.status().code() == absl::StatusCode::kInvalidArgument ||
               clock.Monotonic() - heard > kPatience) {
      return status;
    }
    absl::SleepFor(
        std::clamp((clock.Monotonic() - start) / kPollsInAWait, kShortestPoll, kLongestPoll));
  }
}

}  // namespace myograde::server
