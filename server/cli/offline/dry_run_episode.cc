#include "server/cli/offline/dry_run_episode.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/outcome.h"
#include "server/base/counted.h"
#include "server/cli/offline/local.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Of a budget: what one episode here takes, another one or a slower host may take twice over.
constexpr double kMuch = 0.5;
constexpr double kMuchMemory = 0.8;

Finding EpisodeFinding(const EpisodeRow& row, const Json& shown) {
  const std::string steps = CountCell(shown, "steps", "step");
  if (shown["fault"].is_object()) {
    return {"episode", FindingState::kFails,
            absl::StrCat("the practice episode ended as ", std::string(OutcomeName(row.outcome)),
                         " after ", steps, ": ", Cell(shown["fault"], "detail")),
            "mend the policy; what it printed last is below"};
  }
  std::string found = absl::StrCat("the practice episode was played to its end: ",
                                   std::string(OutcomeName(row.outcome)));
  if (row.reason != FailureReason::kNone) absl::StrAppend(&found, " (", std::string(row.reason.name()), ")");
  return {"episode", FindingState::kOk, absl::StrCat(found, " after ", steps), ""};
}

std::string Seconds(double seconds) {
  if (seconds < 1) return absl::StrFormat("%.3g ms", seconds * 1e3);
  return seconds < 100 ? absl::StrFormat("%.3g s", seconds) : absl::StrFormat("%.0f s", seconds);
}

// CPU time of an average step and of the longest block of an evaluation of so many `episodes`, all
// like this one: the policy starts once in a block.
Finding TimeFinding(const TrackConfig& track, int64_t episodes, const Json& row, const Json& usage) {
  const double episode_s = row.value("policy_cpu_s", 0.0);
  const auto steps = row.value("steps", int64_t{0});
  const double step_s = steps > 0 ? episode_s / static_cast<double>(steps) : 0;
  const double start_s = std::max(0.0, usage.value("policy_cpu_s", 0.0) - episode_s);
  const int64_t block = std::min(episodes, track.episodes_per_lease);
  const double block_s = start_s + episode_s * static_cast<double>(block);
  const Budgets& budgets = track.budgets;
  Finding finding = {"time", FindingState::kOk,
                     absl::StrCat("the start takes ", Seconds(start_s), " of CPU time, a step ",
                                  Seconds(step_s), " on average, of ", Seconds(budgets.step_s),
                                  "; a block of ", Counted(block, "such episode"), " ",
                                  Seconds(block_s), " of ", Seconds(budgets.lease_cpu_s)),
                     ""};
  if (block_s > budgets.lease_cpu_s) {
    finding.state = FindingState::kFails;
    finding.todo = "make the policy faster: the last episodes of a block would be lost";
  } else if (step_s > kMuch * budgets.step_s || block_s > kMuch * budgets.lease_cpu_s) {
    finding.state = FindingState::kWarning;
    finding.todo = "make the policy faster, as a slower host or a longer episode could break the budget";
  }
  return finding;
}

std::string Mebibytes(int64_t bytes) { return absl::StrCat((bytes + (1 << 19)) >> 20, " MiB"); }

Finding MemoryFinding(const Budgets& budgets, const Json& usage) {
  const auto peak = usage.value("peak_memory_bytes", int64_t{0});
  if (peak == 0) {
    return {"memory", FindingState::kUnknown, "this host can't measure the policy's memory",
            absl::StrCat("the limit is ", Mebibytes(budgets.memory_bytes),
                         "; \"myograde doctor\" says what is missing here")};
  }
  const std::string found = absl::StrCat("the policy took ", Mebibytes(peak), " of ",
                                         Mebibytes(budgets.memory_bytes));
  if (static_cast<double>(peak) <= kMuchMemory * static_cast<double>(budgets.memory_bytes)) {
    return {"memory", FindingState::kOk, found, ""};
  }
  return {"memory", FindingState::kWarning, found,
          "use less: a policy that takes more is killed, which costs the episode"};
}

Finding OutputFinding(const Budgets& budgets, const Json& output) {
  if (!output.value("stdout_truncated", false) && !output.value("stderr_truncated", false)) {
    return {"output", FindingState::kOk, "all that the policy printed is kept", ""};
  }
  return {"output", FindingState::kWarning,
          absl::StrCat("the policy printed more than the ", budgets.output_bytes,
                       " bytes of a stream that are kept"),
          "print less, or what you look for may be missing"};
}

}  // namespace

DryEpisode PlayDryEpisode(const LocalOrder& order, int64_t episodes) {
  DryEpisode episode;
  episode.output = Json::array();
  absl::StatusOr<LocalResult> result;
  {
    Progress progress("practice episode");
    LocalRun run(order, {.progress = [&](int64_t done, int64_t total) {
                           progress.Show(done, total, "");
                         },
                         .stopped = StopRequested});
    result = run.Run();
  }
  if (!result.ok()) {
    episode.findings.push_back({"episode", FindingState::kUnknown,
                                absl::StrCat("this host could not play: ", result.status().message()),
                                "\"myograde doctor\" says what this host lacks"});
    return episode;
  }
  episode.interrupted = result->interrupted;
  episode.output = result->outputs;
  if (result->rows.empty()) {
    episode.findings.push_back({"episode", FindingState::kUnknown,
                                "the practice episode was interrupted", "try again"});
    return episode;
  }
  episode.row = LocalRowJson(result->rows.front());
  episode.findings.push_back(EpisodeFinding(result->rows.front(), episode.row));
  if (episode.output.empty()) return episode;
  const Json& output = episode.output.front();
  const Json usage = output.value("usage_wall_cpu", Json::object());
  const TrackConfig& track = order.track->config;
  episode.findings.push_back(TimeFinding(track, episodes, episode.row, usage));
  episode.findings.push_back(MemoryFinding(track.budgets, usage));
  episode.findings.push_back(OutputFinding(track.budgets, output));
  return episode;
}

}  // namespace myograde::server
