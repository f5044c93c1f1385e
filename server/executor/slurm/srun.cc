#include "server/executor/slurm/srun.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"

namespace myograde::server {
namespace {

constexpr double kMiB = 1 << 20;
// For the simulator, the runner and the node's program.
constexpr double kGraderMiB = 1024;
// For a node to prove itself, fetch and unpack, beside the lease's own time.
constexpr absl::Duration kAround = absl::Minutes(10);
constexpr absl::Duration kEnergy = absl::Seconds(5);
constexpr size_t kLongestLine = 200;
constexpr size_t kMostAnswer = 64u << 20;

// States of jobs that are over. One that a later version adds counts as not over, and is asked for
// again.
struct EndState {
  std::string_view state;
  const char* how;
};
constexpr EndState kEnds[] = {
    {"COMPLETED", "ended"},
    {"FAILED", "failed"},
    {"TIMEOUT", "reached its time limit"},
    {"DEADLINE", "reached its time limit"},
    {"OUT_OF_MEMORY", "used more memory than a lease's job may have"},
    {"NODE_FAIL", "was lost with its node"},
    {"BOOT_FAIL", "was lost with its node"},
    {"PREEMPTED", "was preempted"},
    {"REVOKED", "was cancelled"},
    {"CANCELLED", "was cancelled"},
};

const EndState* FindEndState(std::string_view state) {
  const auto* found = std::find_if(std::begin(kEnds), std::end(kEnds),
                                   [&](const EndState& end) { return end.state == state; });
  return found == std::end(kEnds) ? nullptr : found;
}

}  // namespace

std::vector<std::string> JobWords(const SlurmConfig& config, const Budgets& budgets,
                                  absl::Duration wall) {
  const auto or_else = [](int64_t own, double fallback) {
    return own != 0 ? own : static_cast<int64_t>(std::ceil(fallback));
  };
  const auto bytes = static_cast<double>(budgets.memory_bytes + budgets.scratch_bytes);
  // Policy and simulator take turns.
  const int64_t cpus = or_else(config.cpus, std::max(1.0, budgets.cpus));
  const int64_t mib = or_else(config.memory_mib, bytes / kMiB + kGraderMiB);
  const int64_t minutes = or_else(config.time_limit_min, absl::ToDoubleMinutes(wall + kAround));
  std::vector<std::string> words = config.extra_options;
  const std::pair<const char*, const std::string*> places[] = {
      {"--partition=", &config.partition}, {"--account=", &config.account},
      {"--qos=", &config.qos},             {"--constraint=", &config.constraint},
      {"--reservation=", &config.reservation}};
  for (const auto& [option, value] : places) {
    if (!value->empty()) words.push_back(option + *value);
  }
  words.insert(words.end(), {"--nodes=1", "--ntasks=1", absl::StrCat("--cpus-per-task=", cpus),
                             absl::StrCat("--mem=", mib, "M"), absl::StrCat("--time=", minutes)});
  return words;
}

absl::StatusOr<std::string> SlurmCommand(const SlurmConfig& config, const std::string& name) {
  if (config.slurm_bin_dir.empty()) {
    absl::StatusOr<std::string> found = FindProgram(name);
    if (found.ok()) return found;
    return absl::FailedPreconditionError(absl::StrCat(
        name, " is in no folder of PATH; install Slurm's commands, or name their folder in "
              "\"slurm_bin_dir\" of server.json"));
  }
  std::string path = absl::StrCat(config.slurm_bin_dir, "/", name);
  if (access(path.c_str(), X_OK) == 0) return path;
  return absl::FailedPreconditionError(
      absl::StrCat("there is no program ", path, " (\"slurm_bin_dir\" of server.json)"));
}

std::string WithoutName(std::string_view line, std::string_view name) {
  const std::string own = absl::StrCat(std::string(name), ": ");
  for (const std::string_view prefix : {std::string_view(own), std::string_view("error: "),
                                        std::string_view("fatal: ")}) {
    if (line.starts_with(prefix)) line.remove_prefix(prefix.size());
  }
  return std::string(line);
}

absl::StatusOr<std::string> RunSlurm(const std::string& path, std::vector<std::string> words,
                                     absl::Duration deadline,
                                     const std::function<bool()>& stopped) {
  ASSIGN_OR_RETURN(ProgramEnd end, RunProgram({.program = path,
                                               .words = std::move(words),
                                               .most_output = kMostAnswer,
                                               .deadline = deadline,
                                               .nice = 0,
                                               .environment = SlurmEnvironment()},
                                              stopped));
  if (end.exit_status == 0) return std::move(end.output);
  const std::string name = path.substr(path.rfind('/') + 1);
  const std::string said = WithoutName(end.LastError(), name);
  return absl::UnavailableError(absl::StrCat(name, ": ", said.empty() ? end.HowItEnded() : said));
}

bool SlurmJob::over() const { return FindEndState(state) != nullptr; }

std::string SlurmJob::HowItEnded() const {
  const EndState* end = FindEndState(state);
  return end == nullptr ? "ended" : end->how;
}

bool SlurmJob::AtALimit() const {
  return state == "TIMEOUT" || state == "DEADLINE" || state == "OUT_OF_MEMORY";
}

std::vector<std::string> QueueWords(const std::string& job_name) {
  return {"--noheader", "--states=all", "--name=" + job_name, absl::StrCat("--user=", geteuid()),
          "--Format=JobID:|,State:|,NodeList:|,Comment:|,Reason:"};
}

absl::StatusOr<std::vector<SlurmJob>> ParseQueue(std::string_view text) {
  std::vector<SlurmJob> jobs;
  const std::vector<std::string> lines =
      absl::StrSplit(absl::string_view(text.data(), text.size()), '\n', absl::SkipWhitespace());
  for (const std::string& line : lines) {
    // Nothing before the reason holds a bar.
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits('|', 4));
    if (parts.size() != 5) {
      return absl::InternalError(absl::StrCat("squeue printed \"", line.substr(0, kLongestLine), "\""));
    }
    jobs.push_back({.id = parts[0],
                    .state = parts[1],
                    .node = parts[2],
                    .comment = parts[3],
                    .reason = std::string(absl::StripAsciiWhitespace(parts[4]))});
  }
  return jobs;
}

std::optional<double> ParseEnergy(std::string_view answer) {
  double total = 0;
  for (absl::string_view line :
       absl::StrSplit(absl::string_view(answer.data(), answer.size()), '\n')) {
    line = line.substr(0, line.find('|'));
    if (double joules = 0; absl::SimpleAtod(line, &joules) && std::isfinite(joules) && joules > 0) {
      total += joules;
    }
  }
  // 2^63 and the like are Slurm's ways to say that it does not know.
  if (total <= 0 || total > 1e15) return std::nullopt;
  return total;
}

std::optional<double> EnergyOfJob() {
  const char* job = std::getenv("SLURM_JOB_ID");
  if (job == nullptr || *job == '\0') return std::nullopt;
  const absl::StatusOr<std::string> program = FindProgram("sstat");
  if (!program.ok()) return std::nullopt;
  const absl::StatusOr<std::string> answer =
      RunSlurm(*program,
               {"--noheader", "--parsable2", "--format=ConsumedEnergyRaw",
                absl::StrCat("--jobs=", job, ".0")},
               kEnergy);
  if (!answer.ok()) return std::nullopt;
  return ParseEnergy(*answer);
}

}  // namespace myograde::server
