#include "server/sandbox/process_tree.h"

#include <dirent.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <optional>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/sandbox/kernel_files.h"

namespace myograde::server {
namespace {

// The factor by which the estimate must exceed what was waited for, so that chance alone
// accumulates nothing; and how much estimated time may accumulate before it is charged, per
// processor in use.
constexpr double kTolerance = 1.25;
constexpr double kSlackNs = 0.5e9;
// A delayed runner samples less often than it should; the estimated spacing is capped at this factor.
constexpr double kMostSpacing = 5;
constexpr double kNewest = 0.05;

int64_t TickNs() {
  static const int64_t tick = 1000000000 / sysconf(_SC_CLK_TCK);
  return tick;
}

struct ProcessTimes {
  pid_t parent = 0;
  int64_t start = 0;
  char state = 'X';
  int64_t threads = 1;
  int64_t own_ticks = 0;
  int64_t children_ticks = 0;
};

std::optional<ProcessTimes> ReadStat(const std::string& path) {
  const std::string text = ReadKernelFile(path);
  // The name, in brackets, may contain anything; the numbers follow the last bracket.
  const size_t name_end = text.rfind(')');
  if (name_end == std::string::npos) return std::nullopt;
  ProcessTimes times;
  int64_t user = 0, system = 0, children_user = 0, children_system = 0;
  if (std::sscanf(text.c_str() + name_end + 1,
                  " %c %d %*d %*d %*d %*d %*u %*u %*u %*u %*u %ld %ld %ld %ld %*d %*d %ld %*d %ld",
                  &times.state, &times.parent, &user, &system, &children_user, &children_system,
                  &times.threads, &times.start) != 8) {
    return std::nullopt;
  }
  times.own_ticks = user + system;
  times.children_ticks = children_user + children_system;
  return times;
}

// The CPU clock of a process is exact, while /proc/PID/stat counts in ticks of 10 ms, which is many
// steps of a quick policy. Anybody may read it (clock_getcpuclockid(3)). nullopt: the process is
// gone.
std::optional<int64_t> OwnNs(pid_t pid, int64_t otherwise) {
  clockid_t clock;
  timespec time;
  if (const int error = clock_getcpuclockid(pid, &clock); error != 0) {
    if (error == ESRCH) return std::nullopt;
    return otherwise;
  }
  if (clock_gettime(clock, &time) != 0) return std::nullopt;
  return time.tv_sec * int64_t{1000000000} + time.tv_nsec;
}

// A runnable thread may be waiting for a processor; the share of its time that it has spent running
// tells how likely it is on one now. For a thread in `folder`.
double OnProcessor(const std::string& folder, char state) {
  if (state != 'R') return 0;
  unsigned long long ran = 0, waited = 0;
  const std::string text = ReadKernelFile(folder + "/schedstat");
  if (std::sscanf(text.c_str(), "%llu %llu", &ran, &waited) != 2) return 1;
  if (ran == 0) return 0;
  return static_cast<double>(ran) / (static_cast<double>(ran) + static_cast<double>(waited));
}

double ThreadsOnProcessors(pid_t pid, const ProcessTimes& times, bool each) {
  const std::string folder = absl::StrCat("/proc/", pid);
  if (times.threads <= 1 || !each) return OnProcessor(folder, times.state);
  double running = 0;
  for (const pid_t thread : NumbersIn(folder + "/task")) {
    const std::string of = absl::StrCat(folder, "/task/", thread);
    if (const auto seen = ReadStat(of + "/stat"); seen.has_value()) {
      running += OnProcessor(of, seen->state);
    }
  }
  return running;
}

}  // namespace

std::vector<pid_t> NumbersIn(const std::string& folder) {
  std::vector<pid_t> numbers;
  DIR* entries = opendir(folder.c_str());
  if (entries == nullptr) return numbers;
  while (const dirent* entry = readdir(entries)) {
    const auto number = static_cast<pid_t>(std::atol(entry->d_name));
    if (number > 0) numbers.push_back(number);
  }
  closedir(entries);
  return numbers;
}

void CpuLedger::AddSample(const std::map<ProcessKey, ProcessSeen>& seen,
                          const std::set<pid_t>& leaving, absl::Duration now, bool by_chance) {
  double ran_on_ns = 0;
  std::map<ProcessKey, ProcessSeen> known = seen;
  std::map<ProcessKey, double> run_on_ns;
  bool ended = false;
  for (const auto& [key, before] : known_) {
    if (seen.contains(key)) continue;
    if (leaving.contains(key.first)) {
      known[key] = before;
      run_on_ns[key] = run_on_ns_[key];
      continue;
    }
    ended = true;
    ended_own_ns_ += before.own_ns;
    ran_on_ns += run_on_ns_[key];
  }
  samples_since_end_ = ended ? 0 : std::min(samples_since_end_ + 1, kCalmSamples);

  int64_t children_ns = 0;
  int64_t parents = 1;
  for (const auto& [key, now_seen] : known) {
    children_ns += now_seen.children_ns;
    parents += now_seen.children_ns > 0 ? 1 : 0;
    const auto before = known_.find(key);
    const int64_t own_before = before == known_.end() ? 0 : before->second.own_ns;
    total_ns_ += std::max<int64_t>(now_seen.own_ns - own_before, 0);
  }
  // What parents have of their children beyond what was seen of these while they lived. A parent's
  // own account moves on with it when it ends. The kernel truncates two numbers of each parent to
  // whole ticks, so slightly less than before is no loss.
  const int64_t collected_ns = children_ns - ended_own_ns_;
  const int64_t fresh_ns = std::max<int64_t>(collected_ns - most_collected_ns_, 0);
  const int64_t cut_ns = 2 * TickNs() * parents;
  most_collected_ns_ = std::min(most_collected_ns_ + fresh_ns, collected_ns + cut_ns);
  total_ns_ += fresh_ns;

  missing_ns_ += ran_on_ns - kTolerance * static_cast<double>(fresh_ns);
  missing_ns_ = std::max(missing_ns_, 0.0);
  const double slack = kSlackNs * std::max(widest_, 1.0) + static_cast<double>(cut_ns);
  if (missing_ns_ > slack) {
    total_ns_ += static_cast<int64_t>(missing_ns_ - slack);
    missing_ns_ = slack;
  }

  if (by_chance) {
    const absl::Duration most = kMostSpacing * apart_;
    const absl::Duration since = std::min(now - last_by_chance_, most);
    if (last_by_chance_ > -absl::InfiniteDuration()) {
      spacing_ = std::clamp((1 - kNewest) * spacing_ + kNewest * since, apart_, most);
    }
    last_by_chance_ = now;
    double running = 0;
    for (const auto& [key, now_seen] : seen) {
      running += now_seen.running;
      run_on_ns[key] = now_seen.running * absl::ToDoubleNanoseconds(spacing_);
    }
    widest_ = std::max(running, (1 - kNewest) * widest_);
  }
  known_ = std::move(known);
  run_on_ns_ = std::move(run_on_ns);
}

int64_t ProcessTree::CpuNs(bool by_chance) {
  // First list the processes, then read children's times, then each one's own: a process that is
  // alive at the end is in no parent's time, and one that was missing at first is in it already.
  const std::vector<pid_t> listed = NumbersIn("/proc");
  std::map<pid_t, ProcessTimes> processes;
  std::multimap<pid_t, pid_t> children;
  std::set<pid_t> leaving;
  for (const pid_t pid : listed) {
    if (const auto times = ReadStat(absl::StrCat("/proc/", pid, "/stat")); times.has_value()) {
      processes[pid] = *times;
      children.emplace(times->parent, pid);
    } else {
      leaving.insert(pid);
    }
  }
  // Only of the tree: the host may have many more processes. A process that was in it stays in it,
  // even if its parent ended while we read.
  std::vector<pid_t> open = {root_};
  for (const auto& [key, before] : ledger_.known()) {
    const auto found = processes.find(key.first);
    if (found != processes.end() && found->second.start == key.second) open.push_back(key.first);
  }
  std::set<pid_t> reached;
  std::map<ProcessKey, ProcessSeen> seen;
  while (!open.empty()) {
    const pid_t pid = open.back();
    open.pop_back();
    const auto found = processes.find(pid);
    if (found == processes.end() || !reached.insert(pid).second) continue;
    const auto [first, last] = children.equal_range(pid);
    for (auto child = first; child != last; ++child) open.push_back(child->second);
    const ProcessTimes& times = found->second;
    const double running = ThreadsOnProcessors(pid, times, ledger_.churns());
    const std::optional<int64_t> own_ns = OwnNs(pid, times.own_ticks * TickNs());
    if (own_ns.has_value()) {
      seen[{pid, times.start}] = {*own_ns, times.children_ticks * TickNs(), running};
    } else {
      leaving.insert(pid);
    }
  }
  ledger_.AddSample(seen, leaving, SystemClock().Monotonic(), by_chance);
  return ledger_.total_ns();
}

std::vector<pid_t> ProcessTree::members() const {
  std::vector<pid_t> members;
  for (const auto& [key, seen] : ledger_.known()) members.push_back(key.first);
  return members;
}

bool AnyThreadIs(std::string_view states, const std::vector<pid_t>& processes) {
  for (const pid_t pid : processes) {
    const std::string folder = absl::StrCat("/proc/", pid, "/task");
    for (const pid_t thread : NumbersIn(folder)) {
      const auto seen = ReadStat(absl::StrCat(folder, "/", thread, "/stat"));
      if (seen.has_value() && states.find(seen->state) != states.npos) return true;
    }
  }
  return false;
}

}  // namespace myograde::server
