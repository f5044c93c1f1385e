#include "server/executor/slurm/energy.h"

#include <cmath>
#include <cstdlib>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "server/base/child_process.h"

namespace myograde::server {

std::optional<double> ParseEnergy(std::string_view answer) {
  double total = 0;
  for (absl::string_view line : absl::StrSplit(absl::string_view(answer.data(), answer.size()), '\n')) {
    line = line.substr(0, line.find('|'));
    if (double joules = 0; absl::SimpleAtod(line, &joules) && std::isfinite(joules) && joules > 0) {
      total += joules;
    }
  }
  // 2^63 and the like are Slurm's ways to say that it does not know.
  if (total <= 0 || total > 1e15) return std::nullopt;
  return total;
}

std::optional<double> EnergyOfJob(absl::Duration most) {
  const char* job = std::getenv("SLURM_JOB_ID");
  if (job == nullptr || *job == '\0') return std::nullopt;
  const absl::StatusOr<std::string> program = FindProgram("sstat");
  if (!program.ok()) return std::nullopt;
  const absl::StatusOr<ProgramEnd> end =
      RunProgram({.program = *program,
                  .words = {"--noheader", "--parsable2", "--format=ConsumedEnergyRaw",
                            absl::StrCat("--jobs=", job, ".0")},
                  .most_output = 4096,
                  .deadline = most,
                  .nice = 0});
  if (!end.ok() || end->exit_status != 0) return std::nullopt;
  return ParseEnergy(end->output);
}

}  // namespace myograde::server
