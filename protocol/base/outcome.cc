#include "protocol/base/outcome.h"

#include <array>
#include <utility>

namespace myograde {
namespace {

constexpr std::array<std::pair<Outcome, std::string_view>, 14> kOutcomes = {{
    {Outcome::kSuccess, "success"},
    {Outcome::kFailure, "failure"},
    {Outcome::kUnstable, "unstable"},
    {Outcome::kInitTimeout, "init_timeout"},
    {Outcome::kStepTimeout, "step_timeout"},
    {Outcome::kWallTimeout, "wall_timeout"},
    {Outcome::kCpuLimit, "cpu_limit"},
    {Outcome::kMemoryLimit, "memory_limit"},
    {Outcome::kProcessLimit, "process_limit"},
    {Outcome::kDiskLimit, "disk_limit"},
    {Outcome::kProtocol, "protocol"},
    {Outcome::kCrash, "crash"},
    {Outcome::kCancelled, "cancelled"},
    {Outcome::kGraderError, "grader_error"},
}};

}  // namespace

std::string_view OutcomeName(Outcome outcome) {
  for (const auto& [value, name] : kOutcomes) {
    if (value == outcome) return name;
  }
  return "grader_error";
}

std::optional<Outcome> ParseOutcome(std::string_view name) {
  for (const auto& [value, known] : kOutcomes) {
    if (known == name) return value;
  }
  return std::nullopt;
}

Fault FaultOf(Outcome outcome) {
  switch (outcome) {
    case Outcome::kSuccess:
    case Outcome::kFailure:
    case Outcome::kCancelled:
      return Fault::kNobody;
    case Outcome::kGraderError:
      return Fault::kGrader;
    default:
      return Fault::kParticipant;
  }
}

std::string_view FaultName(Fault fault) {
  switch (fault) {
    case Fault::kNobody: return "nobody";
    case Fault::kParticipant: return "participant";
    case Fault::kGrader: return "grader";
  }
  return "";
}

}  // namespace myograde
