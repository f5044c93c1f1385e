// myograde submit: the request to a daemon (../client/submit.h), or the dry run of it on this host,
// which finds what would fail on the server before anything is sent.
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "protocol/lease/practice_seeds.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/submit.h"
#include "server/cli/offline/local.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

// Of a budget: what one episode here takes, another one or a slower host may take twice over.
constexpr double kMuch = 0.5;
constexpr double kMuchMemory = 0.8;

Finding EpisodeFinding(const EpisodeRow& row, const Json& shown) {
  if (shown["fault"].is_object()) {
    return {
        "episode", FindingState::kFails,
        Filled(shown, "the practice episode ended as {outcome} after {steps:step}: {fault.detail}"),
        "fix the policy; its last output is below"};
  }
  return {
      "episode", FindingState::kOk,
      Filled(shown, row.reason == FailureReason::kNone
                        ? "the practice episode ran to its end: {outcome} after {steps:step}"
                        : "the practice episode ran to its end: {outcome} ({reason}) after "
                          "{steps:step}")};
}

std::string Seconds(double seconds) {
  if (seconds < 1) return absl::StrFormat("%.3g ms", seconds * 1e3);
  return seconds < 100 ? absl::StrFormat("%.3g s", seconds) : absl::StrFormat("%.0f s", seconds);
}

// CPU time of an average step and of the longest block of an evaluation of so many `episodes`, all
// like this one: the policy starts once in a block.
Finding TimeFinding(const TrackConfig& track, int64_t episodes, const Json& row,
                    const Json& usage) {
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
                                  Seconds(block_s), " of ", Seconds(budgets.lease_cpu_s))};
  if (block_s > budgets.lease_cpu_s) {
    finding.state = FindingState::kFails;
    finding.todo = "make the policy faster: it would fail the last episodes of a block";
  } else if (step_s > kMuch * budgets.step_s || block_s > kMuch * budgets.lease_cpu_s) {
    finding.state = FindingState::kWarning;
    finding.todo =
        "make the policy faster: a slower host or a longer episode could exceed the budget";
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
  const std::string found =
      absl::StrCat("the policy used ", Mebibytes(peak), " of ", Mebibytes(budgets.memory_bytes));
  if (static_cast<double>(peak) <= kMuchMemory * static_cast<double>(budgets.memory_bytes)) {
    return {"memory", FindingState::kOk, found};
  }
  return {"memory", FindingState::kWarning, found,
          "use less memory: a policy over the limit is killed and loses the episode"};
}

Finding OutputFinding(const Budgets& budgets, const Json& output) {
  if (!output.value("stdout_truncated", false) && !output.value("stderr_truncated", false)) {
    return {"output", FindingState::kOk, "all output of the policy is kept"};
  }
  return {"output", FindingState::kWarning,
          absl::StrCat("the policy printed more than the ", budgets.output_bytes,
                       " bytes that are kept of each stream"),
          "print less, or the part that you need may be missing"};
}

struct DryReport {
  std::vector<Finding> findings;
  bool answered = false;         // by the server
  Json row;                      // as `local` prints an episode; null if none was played
  Json output = Json::array();   // of the policy, as `local` prints it
  bool interrupted = false;
};

// Plays the first seed of `order` with every limit of the track, and compares what was used with
// the budgets, for an evaluation of so many `episodes`. What keeps this host from playing is a
// finding of the state kUnknown.
void PlayDryEpisode(const LocalOrder& order, int64_t episodes, DryReport& report) {
  std::vector<Finding>& findings = report.findings;
  const absl::StatusOr<LocalResult> result =
      PlayLocally(order, "practice episode", /*report_retries=*/false);
  if (!result.ok()) {
    findings.push_back({"episode", FindingState::kUnknown,
                        absl::StrCat(
                            "this host could not run the episode: ", result.status().message()),
                        "\"myograde doctor\" says what this host lacks"});
    return;
  }
  report.interrupted = result->interrupted;
  report.output = result->outputs;
  if (result->rows.empty()) {
    findings.push_back({"episode", FindingState::kUnknown, "the practice episode was interrupted",
                        "try again"});
    return;
  }
  report.row = LocalRowJson(result->rows.front());
  findings.push_back(EpisodeFinding(result->rows.front(), report.row));
  if (report.output.empty()) return;
  const Json& output = report.output.front();
  const Json usage = output.value("usage_wall_cpu", Json::object());
  const TrackConfig& track = order.track->config;
  findings.push_back(TimeFinding(track, episodes, report.row, usage));
  findings.push_back(MemoryFinding(track.budgets, usage));
  findings.push_back(OutputFinding(track.budgets, output));
}

struct DryRunOptions : SubmitOptions {
  bool dry_run = false;
  int64_t phase_episodes = 0;  // of a ranked submission to the phase, says the server; 0: unknown
  HostOptions host;
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

// What `local` would need to play one episode of practice. Sets how many `episodes` would be played
// of the submission.
absl::StatusOr<LocalOrder> BuildOrder(const DryRunOptions& options, int64_t& episodes) {
  ASSIGN_OR_RETURN(LocalOrder order, MakeLocalOrder({.host = options.host,
                                                     .path = options.path,
                                                     .track = options.track,
                                                     .profile = options.profile,
                                                     .seeds = options.seeds,
                                                     .logs = "",
                                                     .slots = 1}));
  episodes = std::ssize(order.seeds);  // of the option, or of the track
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
  return order;
}

Finding SubmissionFinding(const absl::Status& status, const LocalOrder& order) {
  if (!status.ok()) {
    return {"submission", FindingState::kFails, std::string(status.message()),
            "correct it; see server/artefact/README.md for the rules"};
  }
  const Budgets& budgets = order.track->config.budgets;
  return {
      "submission", FindingState::kOk,
      absl::StrCat("\"", order.artefact.manifest.name, "\" with ",
                   Counted(order.artefact.files, "file"), " of at most ", budgets.submission_files,
                   " and ", order.artefact.bytes, " bytes of at most ", budgets.submission_bytes)};
}

// Whether the program can start here. Runtimes that only the server has keep that unknown.
Finding ProgramFinding(const std::string& path, LocalOrder& order) {
  if (const absl::Status status = TakeRuntimes(order); !status.ok()) {
    return {"program", FindingState::kUnknown,
            absl::StrCat("can't be tried on this host: ", status.message()),
            "install the runtime here, or practise on the server with --episodes 1"};
  }
  if (const absl::Status status = CheckLocalProgram(path, order); !status.ok()) {
    return {"program", FindingState::kFails, std::string(status.message()),
            "correct \"command\" of policy.json, or add the missing file to the submission"};
  }
  return {"program", FindingState::kOk, "the command can start in the sandbox"};
}

FindingState FindWorst(const std::vector<Finding>& findings) {
  FindingState worst = FindingState::kOk;
  for (const Finding& finding : findings) worst = std::max(worst, finding.state);
  return worst;
}

// A problem of this host, rather than of the submission, is the error.
absl::StatusOr<DryReport> Examine(const DryRunOptions& options, const Client& client,
                                  const std::string& temp, int64_t episodes, LocalOrder& order) {
  DryReport report;
  std::vector<Finding>& findings = report.findings;
  const absl::Status taken = TakeSubmission(options.path, options.name, temp, order);
  if (!taken.ok() && ExitOf(taken) == kTrouble) return taken;
  findings.push_back(SubmissionFinding(taken, order));
  if (taken.ok()) findings.push_back(ProgramFinding(options.path, order));
  const bool playable = FindWorst(findings) == FindingState::kOk;
  const Artefact& artefact = order.artefact;
  report.answered = AskAcceptance(client,
                                  {static_cast<const SubmitOptions&>(options), artefact.digest,
                                   artefact.manifest.runtimes, order.track->config.hash},
                                  findings);
  if (playable) {
    PlayDryEpisode(order, episodes, report);
  } else {
    findings.push_back({"episode", FindingState::kUnknown,
                        "no practice episode was played, because the policy can't start here"});
  }
  return report;
}

int ExitOfReport(const DryReport& report) {
  if (FindWorst(report.findings) == FindingState::kFails || report.interrupted) return kNoScore;
  if (!report.answered) return kUnreachable;
  return report.row.is_null() ? kTrouble : kDone;
}

const char* StateName(FindingState state) {
  constexpr const char* kNames[] = {"ok", "warning", "unknown", "fails"};
  return kNames[static_cast<size_t>(state)];
}

Json ReportJson(const DryRunOptions& options, const LocalOrder& order, const Client& client,
                const DryReport& report) {
  Json checks = Json::array();
  for (const Finding& finding : report.findings) {
    checks.push_back({{"name", finding.check},
                      {"state", StateName(finding.state)},
                      {"found", finding.found},
                      {"todo", finding.todo}});
  }
  return {{"team", options.team},
          {"track", options.track},
          {"profile", order.track->config.profile},
          {"phase", TextOrNull(options.phase)},
          {"name", TextOrNull(order.artefact.manifest.name)},
          {"artefact", TextOrNull(order.artefact.digest)},
          {"server", TextOrNull(client.where())},
          {"answered", report.answered},
          {"state", StateName(FindWorst(report.findings))},
          {"checks", std::move(checks)},
          {"episode", report.row},
          {"output", report.output}};
}

void PrintTails(const Json& output) {
  for (const Json& part : output) {
    for (const char* key : {"stdout_tail", "stderr_tail"}) {
      const std::string tail = part.value(key, "");
      if (tail.empty()) continue;
      std::cout << Bold(absl::StrCat("The end of the policy's standard ",
                                     key[3] == 'o' ? "output" : "error"))
                << '\n'
                << Marked(tail);
    }
  }
}

void PrintReport(const DryRunOptions& options, const DryReport& report, const Json& json) {
  std::cout << Bold(absl::StrCat("Dry run of ", Sanitized(options.path),
                                 Filled(json, " on {track}, profile {profile}")))
            << '\n';
  PrintChecks(json["checks"], {"fails", "unknown", "warning"}, "", ": {todo}\n");
  const int status = ExitOfReport(report);
  if (status == kNoScore) PrintTails(report.output);
  const bool warned = RowWith(json["checks"], "state", "warning").is_object();
  std::cout << (status == kNoScore && report.interrupted ? "It was interrupted."
                : status == kNoScore     ? "The submission would fail: see above."
                : status == kUnreachable ? "No failure found; the server was not asked."
                : status == kTrouble     ? "No failure found; no episode was played."
                : warned ? "The submission would be accepted and graded; note the warnings."
                         : "The submission would be accepted and graded.")
            << " Nothing was sent." << std::endl;
}

// Checks the submission here, asks the server whether it would accept it, plays one practice
// episode with all limits on, and reports everything. The exit status: kNoScore if anything would
// fail; else kUnreachable if the server did not answer, kTrouble if this host could not play; else
// kDone. Options that can't be used, and a phase without a server that knows it, are errors.
absl::StatusOr<int> DryRun(DryRunOptions options) {
  CatchStopSignals();
  RETURN_IF_ERROR(CheckPlaceGiven(options));
  const Client client = options.client();
  RETURN_IF_ERROR(TakePhase(client, options));
  int64_t episodes = 0;
  ASSIGN_OR_RETURN(LocalOrder order, BuildOrder(options, episodes));
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("dry-run"));
  ASSIGN_OR_RETURN(const DryReport report, Examine(options, client, temp.path(), episodes, order));
  return PrintAnswer(
      ReportJson(options, order, client, report), options.json,
      [&](const Json& json) { PrintReport(options, report, json); }, ExitOfReport(report));
}

}  // namespace

Command AddSubmit(CLI::App& verb) {
  auto options = std::make_shared<DryRunOptions>();
  CLI::Option* wait = AddSubmitOptions(verb, *options);
  verb.add_flag("--dry-run", options->dry_run,
                "Send nothing: check the submission, ask the server whether it would accept it, "
                "play one practice episode here under all limits, and report what would fail (its "
                "JSON: configs/schema/submit-dry-run.json)")
      ->excludes(wait);
  AddHostOptions(verb, options->host);
  return [options] { return options->dry_run ? DryRun(*options) : Submit(*options); };
}

}  // namespace myograde::server
