// Several environments of one track config, stepped side by side by threads. Results are written
// into arrays that stay in place. What each environment plays does not depend on the number of
// threads.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "sim/python/graded_environment.h"
#include "sim/python/thread_team.h"

namespace myograde::sim {

class VectorEnvironment {
 public:
  // Errors as GradedEnvironment::Make. REQUIRES: count and threads are at least 1.
  static absl::StatusOr<std::unique_ptr<VectorEnvironment>> Make(const EnvironmentOptions& options,
                                                                 int count, int threads);

  // Begins an episode in every environment, of seeds()[i], or in those of `only` (an entry each,
  // not 0) if it is not empty. The first error, of the environment with the lowest index.
  absl::Status Reset(const nlohmann::json& parameters, std::span<const uint8_t> only);

  // Plays a control step in every environment whose episode runs, with its row of `actions`
  // (count() x action_size()). Where an episode ended in the last step, the next one begins, of
  // seeds()[i] and with the leg parameter sets of the last Reset: the row of actions is not looked
  // at, the reward is 0, and was_reset()[i] is 1. InvalidArgumentError for an action that is not
  // finite; nothing is stepped then. FailedPreconditionError before the first Reset.
  absl::Status Step(std::span<const double> actions);

  // Plays what led to the states of environments of the same options, a history for each
  // (GradedEnvironment::Restore), and sets the leg parameter sets of the next episodes. Flags and
  // rewards stay as they are.
  absl::Status Restore(const nlohmann::json& parameters,
                       std::span<const std::vector<EpisodeInputs>> histories);

  int count() const { return static_cast<int>(environments_.size()); }
  int threads() const { return team_.threads(); }
  const GradedEnvironment& at(int i) const { return *environments_[static_cast<size_t>(i)]; }
  std::mutex& mutex() { return mutex_; }

  // What the reward adds the terms up with; as many as reward_terms().
  std::vector<double>& weights() { return weights_; }
  std::vector<uint64_t>& seeds() { return seeds_; }
  // Of the last Reset or Step, row by row. They never move.
  std::vector<double>& observations() { return observations_; }
  std::vector<double>& terms() { return terms_; }
  std::vector<double>& rewards() { return rewards_; }
  std::vector<uint8_t>& terminated() { return terminated_; }
  std::vector<uint8_t>& truncated() { return truncated_; }
  std::vector<uint8_t>& was_reset() { return was_reset_; }

 private:
  VectorEnvironment(std::vector<std::unique_ptr<GradedEnvironment>> environments, int threads);

  absl::Status CheckAlive() const;
  absl::Status StepOne(size_t i, std::span<const double> action);
  absl::Status ResetOne(size_t i);
  void ReadOut(size_t i);
  template <typename Body>
  absl::Status ForEach(Body body);

  std::vector<std::unique_ptr<GradedEnvironment>> environments_;
  ThreadTeam team_;
  std::mutex mutex_;
  nlohmann::json parameters_ = nlohmann::json::object();
  const size_t observation_size_;
  const size_t action_size_;
  const size_t term_count_;
  std::vector<double> weights_;
  std::vector<uint64_t> seeds_;
  std::vector<double> observations_;
  std::vector<double> terms_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_;
  std::vector<uint8_t> truncated_;
  std::vector<uint8_t> was_reset_;
};

}  // namespace myograde::sim
