#include "server/proof/logs.h"

#include <algorithm>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/tracks/registry.h"

namespace myograde::server {
namespace {

bool SameStart(const LogStart& a, const LogStart& b) {
  return a.convention == b.convention &&
         CanonicalJson(a.parameters) == CanonicalJson(b.parameters);
}

// Bit for bit: 0 and -0 are different actions.
bool SameAction(const EpisodeLog& a, const EpisodeLog& b, int64_t step) {
  return std::memcmp(a.action(step).data(), b.action(step).data(),
                     a.action(step).size_bytes()) == 0;
}

// Equal up to the end of the shorter one; the other may go on.
LogDifference CompareEnds(const EpisodeLog& a, const EpisodeLog& b) {
  if (a.end.logged != a.end.steps || b.end.logged != b.end.steps) return {};
  if (a.end.end == b.end.end && a.steps() == b.steps()) return {};
  const int64_t step = std::min(a.steps(), b.steps());
  const std::string detail = absl::StrCat("one playing ended after ", a.steps(), " steps by \"",
                                          a.end.end, "\", the other after ", b.steps(), " by \"",
                                          b.end.end, "\"");
  // An episode that the environment did not end was ended by a fault of the participant's program.
  const EpisodeLog& shorter = a.steps() <= b.steps() ? a : b;
  const bool fault = !ParseEpisodeEnd(shorter.end.end).has_value() ||
                     (a.steps() == b.steps() && !ParseEpisodeEnd(b.end.end).has_value());
  const bool unstable = shorter.end.end == OutcomeName(Outcome::kUnstable);
  return {fault && !unstable ? Cause::kPolicy : Cause::kSimulator, step, detail};
}

}  // namespace

absl::StatusOr<std::string> ReadLog(const std::string& path) {
  ASSIGN_OR_RETURN(const Fd file, OpenToRead(path));
  return ReadPackedLog(file.get());
}

absl::Status CheckLogHash(const std::string& named, const std::string& found) {
  if (named == found) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrCat("the log was altered: its SHA-256 is ", found, ", its record says ", named));
}

LogDifference CompareLogs(const EpisodeLog& a, const EpisodeLog& b) {
  if (a.action_size != b.action_size || a.header.seed != b.header.seed) {
    return {Cause::kSimulator, -1, "the two playings are not of the same episode"};
  }
  if (a.start.has_value() && b.start.has_value() && !SameStart(*a.start, *b.start)) {
    return {Cause::kPolicy, -1, "the policy chose another action convention or other leg "
                                "parameters"};
  }
  const int64_t steps = std::min(a.steps(), b.steps());
  for (int64_t step = 0; step < steps; ++step) {
    const auto at = static_cast<size_t>(step);
    if (a.observations[at] != b.observations[at]) {
      return {Cause::kSimulator, step,
              absl::StrCat("the observation of step ", step,
                           " differs, while everything before it is equal")};
    }
    if (!SameAction(a, b, step)) {
      return {Cause::kPolicy, step,
              absl::StrCat("the policy answered the same observation of step ", step,
                           " with another action")};
    }
    if (a.states[at] != b.states[at]) {
      return {Cause::kSimulator, step,
              absl::StrCat("the same action led to another state in step ", step)};
    }
  }
  return CompareEnds(a, b);
}

}  // namespace myograde::server
