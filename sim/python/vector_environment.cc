#include "sim/python/vector_environment.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::sim {

absl::StatusOr<std::unique_ptr<VectorEnvironment>> VectorEnvironment::Make(
    const EnvironmentOptions& options, int count, int threads) {
  std::vector<std::unique_ptr<GradedEnvironment>> environments;
  for (int i = 0; i < count; ++i) {
    ASSIGN_OR_RETURN(auto made, GradedEnvironment::Make(options));
    environments.push_back(std::move(made));
  }
  return std::unique_ptr<VectorEnvironment>(
      new VectorEnvironment(std::move(environments), std::min(threads, count)));
}

VectorEnvironment::VectorEnvironment(std::vector<std::unique_ptr<GradedEnvironment>> environments,
                                     int threads)
    : environments_(std::move(environments)),
      team_(threads),
      observation_size_(static_cast<size_t>(environments_[0]->observation_size())),
      action_size_(static_cast<size_t>(environments_[0]->action_size())),
      term_count_(environments_[0]->reward_terms().size()),
      seeds_(environments_.size()),
      observations_(environments_.size() * observation_size_),
      terms_(environments_.size() * term_count_),
      rewards_(environments_.size()),
      terminated_(environments_.size()),
      truncated_(environments_.size()),
      was_reset_(environments_.size()) {
  for (const RewardTerm& term : environments_[0]->reward_terms()) weights_.push_back(term.weight);
}

absl::Status VectorEnvironment::Reset(const nlohmann::json& parameters,
                                      std::span<const uint8_t> only) {
  RETURN_IF_ERROR(CheckAlive());
  parameters_ = parameters;
  return ForEach([&](size_t i) {
    if (!only.empty() && only[i] == 0) return absl::OkStatus();
    return ResetOne(i);
  });
}

absl::Status VectorEnvironment::Step(std::span<const double> actions) {
  RETURN_IF_ERROR(CheckAlive());
  for (size_t i = 0; i < environments_.size(); ++i) {
    const GradedEnvironment& environment = *environments_[i];
    if (!environment.running() && terminated_[i] == 0 && truncated_[i] == 0) {
      return absl::FailedPreconditionError(
          absl::StrCat("environment ", i, " has no episode; call reset() first"));
    }
    if (!environment.running()) continue;
    absl::Status status = environment.CheckAction(actions.subspan(i * action_size_, action_size_));
    if (!status.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("environment ", i, ": ", status.message()));
    }
  }
  return ForEach([&](size_t i) {
    return StepOne(i, actions.subspan(i * action_size_, action_size_));
  });
}

absl::Status VectorEnvironment::Restore(const nlohmann::json& parameters,
                                        std::span<const std::vector<EpisodeInputs>> histories) {
  RETURN_IF_ERROR(CheckAlive());
  parameters_ = parameters;
  return ForEach([&](size_t i) {
    if (histories[i].empty()) return absl::OkStatus();
    RETURN_IF_ERROR(environments_[i]->Restore(histories[i]));
    ReadOut(i);
    return absl::OkStatus();
  });
}

absl::Status VectorEnvironment::CheckAlive() const {
  if (team_.alive()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "these environments were created in another process, whose threads a fork does not copy; "
      "create them in the process that steps them");
}

absl::Status VectorEnvironment::StepOne(size_t i, std::span<const double> action) {
  GradedEnvironment& environment = *environments_[i];
  if (!environment.running()) return ResetOne(i);
  RETURN_IF_ERROR(environment.Step(action));
  was_reset_[i] = 0;
  terminated_[i] = environment.terminated();
  truncated_[i] = environment.truncated();
  ReadOut(i);
  rewards_[i] = 0;
  for (size_t term = 0; term < term_count_; ++term) {
    if (weights_[term] != 0) rewards_[i] += weights_[term] * terms_[i * term_count_ + term];
  }
  return absl::OkStatus();
}

absl::Status VectorEnvironment::ResetOne(size_t i) {
  was_reset_[i] = 1;
  terminated_[i] = truncated_[i] = 0;
  rewards_[i] = 0;
  RETURN_IF_ERROR(environments_[i]->Reset(seeds_[i], parameters_));
  ReadOut(i);
  return absl::OkStatus();
}

void VectorEnvironment::ReadOut(size_t i) {
  environments_[i]->Observe(std::span(observations_).subspan(i * observation_size_,
                                                             observation_size_));
  environments_[i]->RewardTerms(std::span(terms_).subspan(i * term_count_, term_count_));
}

template <typename Body>
absl::Status VectorEnvironment::ForEach(Body body) {
  std::vector<absl::Status> statuses(environments_.size());
  team_.ForEach(count(), [&](int i) {
    statuses[static_cast<size_t>(i)] = body(static_cast<size_t>(i));
  });
  const auto failed = std::ranges::find_if_not(statuses, &absl::Status::ok);
  if (failed == statuses.end()) return absl::OkStatus();
  return absl::Status(failed->code(), absl::StrCat("environment ", failed - statuses.begin(), ": ",
                                                   std::string(failed->message())));
}

}  // namespace myograde::sim
