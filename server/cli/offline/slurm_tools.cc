#include "server/cli/offline/slurm_tools.h"

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/status_macros.h"
#include "server/executor/slurm/srun.h"

namespace myograde::server {
namespace {

constexpr size_t kMostOutput = 16u << 20;  // sinfo of a large cluster

}  // namespace

absl::StatusOr<ProgramEnd> SlurmTools::Run(const std::string& name,
                                           const std::vector<std::string>& words,
                                           absl::Duration deadline) const {
  ASSIGN_OR_RETURN(const std::string path, SlurmCommand(config_, name));
  ASSIGN_OR_RETURN(ProgramEnd end, RunProgram({.program = path,
                                               .words = words,
                                               .most_output = kMostOutput,
                                               .deadline = deadline,
                                               .nice = 0,
                                               .environment = SlurmEnvironment()}));
  if (end.exit_status != 0) {
    const std::string last = end.LastError();
    return absl::UnavailableError(
        absl::StrCat(name, " ", end.HowItEnded(), last.empty() ? "" : ": ", last));
  }
  return end;
}

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

}  // namespace myograde::server
