#include "server/cli/offline/dry_run.h"

#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/outcome.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/practice_seeds.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/finding.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/acceptance.h"
#include "server/cli/offline/dry_run_episode.h"
#include "server/cli/offline/local.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct Report {
  std::vector<Finding> findings;
  bool answered = false;  // by the server
  DryEpisode episode;
};

// A track and a profile that the options leave to the phase are the phase's.
absl::Status TakePhase(const Client& client, DryRunOptions& options) {
  if (options.phase.empty()) return absl::OkStatus();
  const absl::StatusOr<Json> phase = FindPhaseOf(client, options.phase);
  if (!phase.ok()) {
    const bool needed = options.track.empty() ||
                        phase.status().code() == absl::StatusCode::kInvalidArgument;
    return needed ? phase.status() : absl::OkStatus();
  }
  if (options.track.empty()) options.track = phase->value("track", "");
  if (options.profile.empty()) options.profile = phase->value("profile", "");
  options.phase_episodes = phase->value("episodes", int64_t{0});
  return absl::OkStatus();
}

// What would be played, of which one episode is.
struct DryOrder {
  LocalOrder local;
  int64_t episodes = 0;
};

// What `local` would need to play one episode of practice.
absl::StatusOr<DryOrder> OrderOf(const DryRunOptions& options) {
  LocalOptions local;
  local.host = options.host;
  local.path = options.path;
  local.track = options.track;
  local.profile = options.profile;
  local.seeds = options.seeds;
  local.slots = 1;
  ASSIGN_OR_RETURN(LocalOrder order, MakeLocalOrder(local));
  const int64_t listed = std::ssize(order.seeds);  // of the option, or of the track
  int64_t episodes = listed;
  if (options.seeds.empty() && options.phase_episodes > 0) episodes = options.phase_episodes;
  if (options.episodes > 0) episodes = options.episodes;
  if (options.seeds.empty()) {
    const TrackConfig& track = order.track->config;
    order.seeds = track.practice_seeds;
    if (order.seeds.empty()) {
      order.seeds = DefaultPracticeSeeds({track.seeds.begin(), track.seeds.end()}, 1);
    }
  }
  order.seeds.resize(1);
  return DryOrder{std::move(order), episodes};
}

Finding SubmissionFinding(const absl::Status& status, const LocalOrder& order) {
  if (!status.ok()) {
    return {"submission", FindingState::kFails, std::string(status.message()),
            "mend it; server/artefact/README.md has the rules"};
  }
  const Budgets& budgets = order.track->config.budgets;
  return {"submission", FindingState::kOk,
          absl::StrCat("\"", order.artefact.manifest.name, "\" with ",
                       Counted(order.artefact.files, "file"), " of at most ",
                       budgets.submission_files, " and ", order.artefact.bytes,
                       " bytes of at most ", budgets.submission_bytes),
          ""};
}

// Whether the program can start here. Runtimes that only the server has keep that unknown.
Finding ProgramFinding(const std::string& path, LocalOrder& order) {
  if (const absl::Status status = TakeRuntimes(order); !status.ok()) {
    return {"program", FindingState::kUnknown,
            absl::StrCat("can't be tried on this host: ", status.message()),
            "provide the runtime here, or practise on the server with --episodes 1"};
  }
  if (const absl::Status status = CheckLocalProgram(path, order); !status.ok()) {
    return {"program", FindingState::kFails, std::string(status.message()),
            "mend \"command\" of policy.json, or put the missing file into the submission"};
  }
  return {"program", FindingState::kOk, "the command can start in the sandbox", ""};
}

SubmissionPlan PlanOf(const DryRunOptions& options, const LocalOrder& order) {
  return {.team = options.team,
          .track = options.track,
          .profile = options.profile,
          .phase = options.phase,
          .practice = !options.seeds.empty() || options.episodes > 0,
          .artefact = order.artefact.digest,
          .runtimes = order.artefact.manifest.runtimes,
          .config = order.track->config.hash};
}

void Append(std::vector<Finding>& findings, std::vector<Finding> more) {
  for (Finding& finding : more) findings.push_back(std::move(finding));
}

// A problem of this host, rather than of the submission, is the error.
absl::StatusOr<Report> Examine(const DryRunOptions& options, const Client& client,
                               const std::string& temp, DryOrder& dry) {
  LocalOrder& order = dry.local;
  Report report;
  const absl::Status taken = TakeSubmission(options.path, options.name, temp, order);
  if (!taken.ok() && ExitOf(taken) == kTrouble) return taken;
  report.findings.push_back(SubmissionFinding(taken, order));
  if (taken.ok()) report.findings.push_back(ProgramFinding(options.path, order));
  const bool playable = WorstOf(report.findings) == FindingState::kOk;
  Acceptance acceptance = AskAcceptance(client, PlanOf(options, order));
  report.answered = acceptance.answered;
  Append(report.findings, std::move(acceptance.findings));
  report.episode.output = Json::array();
  if (playable) {
    report.episode = PlayDryEpisode(order, dry.episodes);
    Append(report.findings, report.episode.findings);
  } else {
    report.findings.push_back({"episode", FindingState::kUnknown,
                               "no practice episode was played, as the policy can't start here", ""});
  }
  return report;
}

int ExitOfReport(const Report& report) {
  if (HasFinding(report.findings, FindingState::kFails) || report.episode.interrupted) {
    return kNoScore;
  }
  if (!report.answered) return kUnreachable;
  return report.episode.row.is_null() ? kTrouble : kDone;
}

Json ReportJson(const DryRunOptions& options, const LocalOrder& order, const Client& client,
                const Report& report) {
  const auto or_null = [](const std::string& text) { return text.empty() ? Json() : Json(text); };
  return {{"team", options.team},
          {"track", options.track},
          {"profile", order.track->config.profile},
          {"phase", or_null(options.phase)},
          {"name", or_null(order.artefact.manifest.name)},
          {"artefact", or_null(order.artefact.digest)},
          {"server", or_null(client.where())},
          {"answered", report.answered},
          {"state", FindingStateName(WorstOf(report.findings))},
          {"checks", FindingsJson(report.findings)},
          {"episode", report.episode.row},
          {"output", report.episode.output}};
}

void PrintOutput(const Json& output) {
  for (const Json& part : output) {
    for (const char* key : {"stdout_tail", "stderr_tail"}) {
      const std::string tail = part.value(key, "");
      if (tail.empty()) continue;
      std::cout << Bold(absl::StrCat("The end of the policy's ", key == std::string("stdout_tail")
                                         ? "standard output" : "standard error")) << '\n'
                << Marked(tail);
    }
  }
}

void PrintReport(const DryRunOptions& options, const LocalOrder& order, const Report& report) {
  std::cout << Bold(absl::StrCat("Dry run of ", Harmless(options.path), " on ", options.track,
                                 ", profile ", order.track->config.profile))
            << '\n';
  PrintFindings(report.findings);
  const int status = ExitOfReport(report);
  if (status == kNoScore) PrintOutput(report.episode.output);
  const bool warned = HasFinding(report.findings, FindingState::kWarning);
  std::cout << (status == kNoScore && report.episode.interrupted ? "It was interrupted."
                : status == kNoScore     ? "The submission would fail: see above."
                : status == kUnreachable ? "Nothing would fail as far as can be known without the server."
                : status == kTrouble     ? "Nothing would fail as far as can be known without an episode."
                : warned ? "The submission would be taken and graded; mind the warnings."
                         : "The submission would be taken and graded.")
            << " Nothing was sent." << std::endl;
}

}  // namespace

int DryRun(DryRunOptions options) {
  CatchStopSignals();
  if (const absl::Status given = CheckPlaceGiven(options); !given.ok()) return ReportError(given);
  const Client client = options.client();
  if (const absl::Status taken = TakePhase(client, options); !taken.ok()) return ReportError(taken);
  absl::StatusOr<DryOrder> order = OrderOf(options);
  if (!order.ok()) return ReportError(order.status());
  const absl::StatusOr<TempFolder> temp = TempFolder::Make("dry-run");
  if (!temp.ok()) return ReportError(temp.status());
  const absl::StatusOr<Report> report = Examine(options, client, temp->path(), *order);
  if (!report.ok()) return ReportError(report.status());
  if (options.json) {
    PrintJson(ReportJson(options, order->local, client, *report));
  } else {
    PrintReport(options, order->local, *report);
  }
  return ExitOfReport(*report);
}

}  // namespace myograde::server
