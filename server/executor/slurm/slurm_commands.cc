#include "server/executor/slurm/slurm_commands.h"

#include <unistd.h>

#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/program_run.h"

namespace myograde::server {
namespace {

// A line takes about a hundred bytes.
constexpr size_t kMostAnswer = 64 << 20;
constexpr size_t kLongestLine = 200;

std::string LineText(const std::string& line) {
  return line.substr(0, kLongestLine);
}

// What a command said, without its own name before it.
std::string Said(const std::string& program, const ProgramEnd& end) {
  std::string said = end.LastError();
  for (const std::string& prefix :
       {absl::StrCat(program, ": "), std::string("error: "), std::string("fatal: ")}) {
    said = std::string(absl::StripPrefix(said, prefix));
  }
  return said.empty() ? end.HowItEnded() : said;
}

// Whether a failed sbatch leaves no doubt that there is no job: it reached the cluster and was
// refused, or could not even begin. Without a word it may have been ended after it was heard.
bool IsRefusal(const std::string& said) {
  for (const char* doubt : {"Unable to contact", "timed out", "Socket", "socket", "onnection",
                            "Zero Bytes", "Communication", "communication"}) {
    if (absl::StrContains(said, doubt)) return false;
  }
  return true;
}

}  // namespace

const char kQueueFormat[] =
    "ArrayJobID:|,ArrayTaskID:|,State:|,NodeList:|,Comment:|,exit_code:|,Reason:";

SlurmCommands::SlurmCommands(SlurmConfig config, std::string job_name,
                             std::function<bool()> stopped, absl::Duration deadline)
    : config_(std::move(config)),
      job_name_(std::move(job_name)),
      stopped_(std::move(stopped)),
      deadline_(deadline) {}

absl::StatusOr<std::string> SlurmCommands::Run(const std::string& program,
                                               std::vector<std::string> words,
                                               const std::string& input) const {
  std::string path = absl::StrCat(config_.slurm_bin_dir, "/", program);
  if (config_.slurm_bin_dir.empty()) {
    const absl::StatusOr<std::string> found = FindProgram(program);
    if (!found.ok()) {
      return absl::FailedPreconditionError(absl::StrCat(
          program, " is in no folder of PATH; install Slurm's commands, or name their folder in "
                   "\"slurm_bin_dir\" of server.json"));
    }
    path = *found;
  }
  if (access(path.c_str(), X_OK) != 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("there is no program ", path, " (\"slurm_bin_dir\" of server.json)"));
  }
  ASSIGN_OR_RETURN(ProgramEnd end, RunProgram({.program = path,
                                               .words = std::move(words),
                                               .input = input,
                                               .most_output = kMostAnswer,
                                               .deadline = deadline_,
                                               .nice = 0,
                                               .environment = SlurmEnvironment()},
                                              stopped_));
  if (end.exit_status == 0) return std::move(end.output);
  const std::string said = Said(program, end);
  const std::string message = absl::StrCat(program, ": ", said);
  const bool refused = end.exit_status < 128 && !end.LastError().empty() && IsRefusal(said);
  return refused ? absl::FailedPreconditionError(message) : absl::UnavailableError(message);
}

absl::StatusOr<int64_t> SlurmCommands::Submit(const BatchOrder& order) const {
  // Later words win, so that no option of the config can change what the bookkeeping relies on.
  std::vector<std::string> words = JobWords(config_, order.needs);
  if (!order.exclude.empty()) {
    words.push_back(absl::StrCat("--exclude=", absl::StrJoin(order.exclude, ",")));
  }
  for (std::string word : {
           std::string("--parsable"), absl::StrCat("--array=0-", order.tasks - 1),
           absl::StrCat("--job-name=", job_name_), absl::StrCat("--comment=", order.batch),
           std::string("--no-requeue"), std::string("--export=NONE"), std::string("--chdir=/"),
           std::string("--output=/dev/null"), std::string("--error=/dev/null")}) {
    words.push_back(std::move(word));
  }
  ASSIGN_OR_RETURN(const std::string answer, Run("sbatch", std::move(words), order.script));
  // "12", or "12;cluster".
  const std::string number(answer.substr(0, answer.find_first_of(";\n")));
  int64_t job = 0;
  if (absl::SimpleAtoi(number, &job) && job > 0) return job;
  return absl::InternalError(absl::StrCat("sbatch answered \"", LineText(answer), "\""));
}

absl::StatusOr<std::vector<SlurmJob>> SlurmCommands::Queue() const {
  const absl::StatusOr<std::string> answer =
      Run("squeue", {"--noheader", "--array", "--states=all", "--name=" + job_name_,
                     absl::StrCat("--user=", geteuid()), absl::StrCat("--Format=", kQueueFormat)},
          "");
  if (!answer.ok()) return answer.status();
  return ParseQueue(*answer);
}

absl::Status SlurmCommands::Cancel(const std::vector<SlurmJob>& jobs) const {
  std::vector<std::string> words = {"--quiet"};
  for (const SlurmJob& job : jobs) words.push_back(job.id());
  return Run("scancel", std::move(words), "").status();
}

absl::Status SlurmCommands::CancelAll() const {
  return Run("scancel", {"--quiet", "--name=" + job_name_, absl::StrCat("--user=", geteuid())}, "")
      .status();
}

absl::StatusOr<std::vector<std::string>> SlurmCommands::Nodes() const {
  std::vector<std::string> words = {"--noheader", "--Node", "--format=%N|%P|%T"};
  if (!config_.partition.empty()) words.push_back("--partition=" + config_.partition);
  ASSIGN_OR_RETURN(const std::string answer, Run("sinfo", std::move(words), ""));
  std::vector<std::string> nodes;
  const std::vector<std::string> lines = absl::StrSplit(answer, '\n', absl::SkipWhitespace());
  for (const std::string& line : lines) {
    const std::vector<std::string> parts = absl::StrSplit(line, '|');
    if (parts.size() != 3) {
      return absl::InternalError(absl::StrCat("sinfo printed \"", LineText(line), "\""));
    }
    // The default partition has a star.
    if (config_.partition.empty() && !absl::EndsWith(parts[1], "*")) continue;
    if (!absl::StartsWith(parts[2], "down") && !absl::StartsWith(parts[2], "drain")) {
      nodes.push_back(parts[0]);
    }
  }
  return nodes;
}

absl::StatusOr<std::vector<SlurmJob>> ParseQueue(const std::string& text) {
  std::vector<SlurmJob> jobs;
  const std::vector<std::string> lines = absl::StrSplit(text, '\n', absl::SkipWhitespace());
  for (const std::string& line : lines) {
    // Nothing before the reason holds a bar.
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits('|', 6));
    SlurmJob job;
    if (parts.size() != 7 || !absl::SimpleAtoi(parts[0], &job.array)) {
      return absl::InternalError(absl::StrCat("squeue printed \"", LineText(line), "\""));
    }
    // Jobs that somebody else submitted by that name may be no arrays.
    if (!absl::SimpleAtoi(parts[1], &job.task)) continue;
    job.state = JobStateOf(parts[2]);
    job.node = parts[3];
    job.batch = parts[4];
    if (!absl::SimpleAtoi(parts[5], &job.wait_status)) job.wait_status = 0;
    job.reason = std::string(absl::StripAsciiWhitespace(parts[6]));
    jobs.push_back(std::move(job));
  }
  return jobs;
}

}  // namespace myograde::server
