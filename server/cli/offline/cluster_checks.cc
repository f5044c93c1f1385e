#include "server/cli/offline/cluster_checks.h"

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include <cmath>
#include <cstdlib>
#include <map>
#include <string_view>
#include <utility>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/executor/slurm/srun.h"

namespace myograde::server {
namespace {

constexpr size_t kMostOutput = 16u << 20;  // sinfo of a large cluster

// A node may have to be given back by another job first; Slurm's own answer is to wait for ever.
constexpr int kNodeWithinSeconds = 30;
constexpr absl::Duration kNodeDeadline = absl::Seconds(90);
// Beyond it, times of day in logs of nodes and of the daemon can't be put together.
constexpr double kClockSkewSeconds = 2;

constexpr char kNoLease[] = "no lease starts; submissions wait";

// What one of Slurm's commands prints. Errors of SlurmCommand and RunProgram; UnavailableError,
// with its last line: it ended with another status than 0.
absl::StatusOr<std::string> RunSlurm(const SlurmConfig& config, const std::string& name,
                                     const std::vector<std::string>& words,
                                     absl::Duration deadline = absl::Seconds(30)) {
  ASSIGN_OR_RETURN(const std::string path, SlurmCommand(config, name));
  ASSIGN_OR_RETURN(ProgramEnd end, RunProgram({.program = path,
                                               .words = words,
                                               .most_output = kMostOutput,
                                               .deadline = deadline,
                                               .nice = 0,
                                               .environment = SlurmEnvironment()}));
  if (end.exit_status == 0) return std::move(end.output);
  const std::string last = end.LastError();
  return absl::UnavailableError(
      absl::StrCat(name, " ", end.HowItEnded(), last.empty() ? "" : ": ", last));
}

// The keys and values of "KEY=VALUE KEY=VALUE" and of lines "KEY = VALUE".
std::map<std::string, std::string> ReadSlurmPairs(std::string_view text) {
  std::map<std::string, std::string> pairs;
  for (const absl::string_view line :
       absl::StrSplit(absl::string_view(text.data(), text.size()), '\n')) {
    if (const size_t wide = line.find(" = "); wide != absl::string_view::npos) {
      pairs.emplace(absl::StripAsciiWhitespace(line.substr(0, wide)),
                    absl::StripAsciiWhitespace(line.substr(wide + 3)));
      continue;
    }
    for (const absl::string_view word : absl::StrSplit(line, ' ', absl::SkipWhitespace())) {
      const size_t equals = word.find('=');
      if (equals == absl::string_view::npos) continue;
      pairs.emplace(word.substr(0, equals), word.substr(equals + 1));
    }
  }
  return pairs;
}

Check Good(std::string name, std::string found) {
  return {std::move(name), CheckState::kOk, std::move(found), "", ""};
}

Check Missing(std::string name, std::string found, std::string todo) {
  return {std::move(name), CheckState::kMissing, std::move(found), kNoLease, std::move(todo)};
}

Check CommandsCheck(const SlurmConfig& config) {
  std::vector<std::string> missing;
  for (const char* name : {"srun", "squeue", "scancel", "scontrol", "sinfo"}) {
    if (!SlurmCommand(config, name).ok()) missing.emplace_back(name);
  }
  if (!missing.empty()) {
    return Missing("slurm_commands", absl::StrCat("there is no ", absl::StrJoin(missing, ", no ")),
                   "install Slurm's commands on this host (Debian: apt-get install slurm-client), or "
                   "name their folder in \"slurm_bin_dir\"");
  }
  const absl::StatusOr<std::string> version = RunSlurm(config, "srun", {"--version"});
  if (!version.ok()) {
    return Missing("slurm_commands", std::string(version.status().message()),
                   "give this host the cluster's configuration (/etc/slurm/slurm.conf, or "
                   "SLURM_CONF)");
  }
  return Good("slurm_commands", std::string(absl::StripAsciiWhitespace(*version)));
}

Check ControllerCheck(const SlurmConfig& config) {
  const absl::StatusOr<std::string> ping = RunSlurm(config, "scontrol", {"ping"});
  const std::string said(ping.ok() ? absl::StripAsciiWhitespace(*ping) : ping.status().message());
  for (const std::string& line : std::vector<std::string>(absl::StrSplit(said, '\n'))) {
    if (ping.ok() && line.ends_with(" UP")) return Good("slurm_controller", line);
  }
  return Missing("slurm_controller", absl::StrCat("no controller answers (", said, ")"),
                 "start slurmctld, or fix the network or the munge key between it and this host");
}

// Nodes of the partition that could take a job, now or later.
Check PartitionCheck(const SlurmConfig& config) {
  std::vector<std::string> words = {"-h", "-o", "%P|%a|%l|%D|%t"};
  if (!config.partition.empty()) words.insert(words.end(), {"-p", config.partition});
  const absl::StatusOr<std::string> sinfo = RunSlurm(config, "sinfo", words);
  if (!sinfo.ok()) {
    return Missing("slurm_partition", std::string(sinfo.status().message()),
                   "see what sinfo prints on this host");
  }
  std::string name;
  std::string state;
  int64_t usable = 0;
  int64_t all = 0;
  for (const absl::string_view line :
       absl::StrSplit(*sinfo, '\n', absl::SkipWhitespace())) {
    const std::vector<std::string> cells = absl::StrSplit(line, '|');
    if (cells.size() != 5) continue;
    if (config.partition.empty() && !cells[0].ends_with('*')) continue;  // not the default one
    name = std::string(absl::StripSuffix(cells[0], "*"));
    state = cells[1];
    int64_t nodes = 0;
    if (!absl::SimpleAtoi(cells[3], &nodes)) continue;
    all += nodes;
    for (const char* good : {"idle", "mix", "alloc", "comp"}) {
      if (cells[4] == good) usable += nodes;
    }
  }
  if (name.empty()) {
    return Missing("slurm_partition",
                   config.partition.empty()
                       ? std::string("the cluster has no default partition")
                       : absl::StrCat("the cluster has no partition \"", config.partition, "\""),
                   "name one that sinfo lists in \"partition\"");
  }
  const std::string found = absl::StrCat("partition ", name, " is ", state, ", ", usable, " of ", all,
                                         " nodes can run jobs");
  if (state != "up" || usable == 0) {
    return Missing("slurm_partition", found,
                   "see `sinfo -R` for why nodes are down, and resume them");
  }
  return Good("slurm_partition", found);
}

// What srun would be told of one lease's job.
std::vector<std::string> JobOptions(const ClusterSubject& subject) {
  const Budgets budgets = subject.track.has_value() ? subject.track->budgets : Budgets();
  const absl::Duration wall = absl::Seconds(budgets.lease_wall_s) + subject.config.lease_grace;
  return JobWords(subject.config.slurm, budgets, wall);
}

// Slurm itself says whether it would take a lease's job: partition, account, QoS, constraint,
// reservation, memory, processors and time.
Check JobCheck(const ClusterSubject& subject) {
  std::vector<std::string> words = JobOptions(subject);
  words.insert(words.end(), {"--test-only", "true"});
  const absl::StatusOr<std::string> end = RunSlurm(subject.config.slurm, "srun", words);
  if (!end.ok()) {
    return Missing("slurm_job", absl::StrCat("Slurm would not accept a lease's job: ",
                                             std::string(end.status().message())),
                   "correct \"partition\", \"account\", \"qos\", \"constraint\", \"reservation\", "
                   "\"memory_mib\", \"cpus\" and \"time_limit_min\" of server.json to what the cluster "
                   "allows this user (sacctmgr show assoc user=$USER, scontrol show partition)");
  }
  return Good("slurm_job",
              absl::StrCat("Slurm would accept a lease's job (", absl::StrJoin(words, " "), ")"));
}

Check LimitsCheck(const SlurmConfig& config) {
  const absl::StatusOr<std::string> shown = RunSlurm(config, "scontrol", {"show", "config"});
  const auto pairs = ReadSlurmPairs(shown.ok() ? *shown : "");
  const auto number = [&](const char* key) {
    int64_t value = 0;
    const auto it = pairs.find(key);
    return it != pairs.end() && absl::SimpleAtoi(it->second, &value) ? value : int64_t{0};
  };
  const int64_t jobs = number("MaxJobCount");
  if (jobs == 0) {
    return {"slurm_limits", CheckState::kDegraded,
            "MaxJobCount can't be read from `scontrol show config`",
            "jobs may be refused when many wait", "run scontrol on this host to see why"};
  }
  const std::string found = absl::StrCat("MaxJobCount is ", jobs, "; the daemon may submit ",
                                         config.most_jobs);
  if (config.most_jobs > jobs) {
    return {"slurm_limits", CheckState::kDegraded, found,
            "srun is refused as soon as the cluster has that many, and leases wait for it",
            "lower \"most_jobs\", or raise MaxJobCount in slurm.conf"};
  }
  return Good("slurm_limits", found);
}

// Prints what a node has, one "KEY=VALUE" a line. $1: programs, $2: cache.
constexpr char kNodeScript[] =
    "echo \"host=$(uname -n)\"; "
    "[ -x \"$1/myograde-node\" ] && echo program=yes || echo program=no; "
    "[ -r \"$2\" ] && [ -n \"$(ls -A \"$2\" 2>/dev/null)\" ] && echo cache=yes || echo cache=no; "
    "echo \"time=$(date +%s)\"";

Check ClockCheck(const std::string& node, const std::string& time, double now_s) {
  double there = 0;
  if (!absl::SimpleAtod(time, &there)) there = now_s;
  const double apart = std::abs(there - now_s);
  const std::string found = absl::StrCat("the clock of ", node, " is within ",
                                         static_cast<int64_t>(apart) + 1, " s of this host's");
  if (apart <= kClockSkewSeconds) return Good("cluster_clock", found);
  return {"cluster_clock", CheckState::kDegraded, found,
          "times in the nodes' logs don't match the daemon's; no result depends on them",
          "run a time service (chrony, systemd-timesyncd) on all nodes"};
}

// What one node has, whichever Slurm gives; srun waits a while for one.
std::vector<Check> NodeChecks(const ClusterSubject& subject) {
  const SlurmConfig& config = subject.config.slurm;
  const std::string bin = config.bin_dir.empty() ? subject.bin_dir : config.bin_dir;
  const std::string cache = config.cache_dir.empty() ? subject.cache_dir : config.cache_dir;
  std::vector<std::string> words = JobOptions(subject);
  words.insert(words.end(),
               {absl::StrCat("--immediate=", kNodeWithinSeconds), "--job-name=myograde-doctor",
                "/bin/sh", "-c", kNodeScript, "doctor", bin, cache});
  const absl::StatusOr<std::string> end = RunSlurm(config, "srun", words, kNodeDeadline);
  const double now = absl::ToDoubleSeconds(SystemClock().Now() - absl::UnixEpoch());
  if (!end.ok()) {
    return {{"cluster_node", CheckState::kDegraded,
             absl::StrCat("no node could be examined: ", std::string(end.status().message())),
             "what nodes lack shows only when their first leases fail",
             "run this again when a node is free, or see what srun prints"}};
  }
  auto pairs = ReadSlurmPairs(*end);
  const std::string node = pairs["host"].empty() ? "the node" : pairs["host"];
  std::vector<std::string> lacks;
  if (pairs["program"] != "yes") lacks.push_back(absl::StrCat(bin, "/myograde-node"));
  if (pairs["cache"] != "yes") lacks.push_back(absl::StrCat("the models in ", cache));
  return {lacks.empty()
              ? Good("cluster_node", node + " has the programs and the models")
              : Missing("cluster_node", absl::StrCat(node, " lacks ", absl::StrJoin(lacks, ", ")),
                        "install this version of MyoGrade at the same paths on all nodes, or set "
                        "\"bin_dir\" and \"cache_dir\""),
          ClockCheck(node, pairs["time"], now)};
}

}  // namespace

std::vector<Check> ExamineCluster(const ClusterSubject& subject) {
  const SlurmConfig& config = subject.config.slurm;
  std::vector<Check> checks;
  checks.push_back(subject.config.on_cluster
                       ? Good("executor", "leases run on the Slurm cluster")
                       : Check{"executor", CheckState::kDegraded,
                               "\"executor\" of server.json is local",
                               "leases run only on the daemon's host",
                               "set \"executor\" to \"slurm\" once the other checks are ok"});
  checks.push_back(CommandsCheck(config));
  if (checks.back().state == CheckState::kMissing) return checks;
  checks.push_back(ControllerCheck(config));
  if (checks.back().state == CheckState::kMissing) return checks;
  checks.insert(checks.end(), {PartitionCheck(config), LimitsCheck(config), JobCheck(subject)});
  if (checks.back().state == CheckState::kMissing) return checks;
  for (Check& check : NodeChecks(subject)) checks.push_back(std::move(check));
  return checks;
}

}  // namespace myograde::server
