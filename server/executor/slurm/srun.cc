#include "server/executor/slurm/job_needs.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr double kMiB = 1 << 20;
// For the simulator, the runner and the node's program.
constexpr int64_t kGraderMiB = 1024;
// For a node to prove itself, fetch and unpack, beside the lease's own time.
constexpr absl::Duration kAround = absl::Minutes(10);

}  // namespace

JobNeeds NeedsOf(const SlurmConfig& config, const Budgets& budgets, absl::Duration wall) {
  JobNeeds needs{config.time_limit_min, config.memory_mib, config.cpus};
  if (needs.minutes == 0) {
    needs.minutes = static_cast<int64_t>(std::ceil(absl::ToDoubleMinutes(wall + kAround)));
  }
  if (needs.memory_mib == 0) {
    const auto bytes = static_cast<double>(budgets.memory_bytes + budgets.scratch_bytes);
    needs.memory_mib = static_cast<int64_t>(std::ceil(bytes / kMiB)) + kGraderMiB;
  }
  // Policy and simulator take turns.
  if (needs.cpus == 0) needs.cpus = std::max<int64_t>(1, std::llround(std::ceil(budgets.cpus)));
  return needs;
}

std::vector<std::string> JobWords(const SlurmConfig& config, const JobNeeds& needs) {
  std::vector<std::string> words = config.extra_options;
  const std::pair<const char*, const std::string*> places[] = {
      {"--partition=", &config.partition}, {"--account=", &config.account},
      {"--qos=", &config.qos},             {"--constraint=", &config.constraint},
      {"--reservation=", &config.reservation}};
  for (const auto& [option, value] : places) {
    if (!value->empty()) words.push_back(option + *value);
  }
  words.insert(words.end(), {"--nodes=1", "--ntasks=1", absl::StrCat("--cpus-per-task=", needs.cpus),
                             absl::StrCat("--mem=", needs.memory_mib, "M"),
                             absl::StrCat("--time=", needs.minutes)});
  return words;
}

}  // namespace myograde::server
