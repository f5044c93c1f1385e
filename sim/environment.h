// One track's environment: what the episode loop steps. Implementations own
// their model and data; nothing here is thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "protocol/tracks/episode_facts.h"
#include "protocol/bridge/frames.h"

struct mjModel_;
struct mjData_;

namespace myograde::sim {

// A term of the official environment's reward.
struct RewardTerm {
  std::string_view name;  // its key in the official reward dictionary
  double weight;          // by default; 0: reported, and not part of the reward
};

// The official dense reward: the sum of the terms times their weights. REQUIRES: as many values as
// terms.
double DenseReward(std::span<const RewardTerm> terms, std::span<const double> values);

// The outcome of one control step.
struct StepResult {
  bool ended = false;     // facts().end says how
  bool unstable = false;  // MuJoCo warned of bad numbers: Outcome::kUnstable
  bool overflow = false;  // a contact or constraint buffer was too small: our fault
};

class Environment {
 public:
  virtual ~Environment() = default;

  // Begins the episode of `seed`. In profiles that carry state over, the order
  // of calls matters and the seed is used by the first only. Leg parameter sets
  // and their selection go back to the defaults.
  virtual void Reset(uint64_t seed) = 0;

  // Takes parameters uploaded by the policy, after Reset: a JSON object of the track's own form, in
  // which each key replaces what was given under it. An error says what is wrong; nothing is taken
  // then.
  virtual absl::Status SetParameters(const nlohmann::json& parameters) {
    if (parameters.empty()) return absl::OkStatus();
    return absl::InvalidArgumentError(
        "the policy uploaded parameter sets, and this track takes none: send none");
  }

  virtual void SetConvention(ActionConvention convention) = 0;

  // Sizes of observation and action vectors.
  virtual int observation_size() const = 0;
  virtual int action_size() const = 0;

  // Writes the observation of the current state; `out` has observation_size()
  // entries, in the order of the layout of its track (protocol/tracks).
  virtual void Observe(std::span<double> out) const = 0;

  // Writes what the official observation dictionary has beyond that; `out` has an entry for each of
  // its track's layout().extra, in that order.
  virtual void ObserveExtra(std::span<double> out) const = 0;

  // Writes the terms of the official reward for the state after the last Reset or Step, without
  // their weights; `out` has an entry for each of SimulatedTrack::reward_terms, in that order.
  // Flags are 0 or 1.
  virtual void RewardTerms(std::span<double> out) const = 0;

  // Plays one control step. REQUIRES: action.size() == action_size(), finite.
  virtual StepResult Step(std::span<const double> action) = 0;

  // Facts of the episode so far (index, seed, digest, wall and CPU times are
  // the episode loop's to fill).
  virtual EpisodeFacts facts() const = 0;

  // Details of the episode so far, finite where its facts are; none before its first step is judged.
  virtual EpisodeDetails details() const { return {}; }

  // The full physics state after the last step (time, qpos, qvel, act), for
  // digests. Valid until the next call of a non-const method.
  virtual std::span<const double> state() const = 0;

  // For pictures. Valid as long as the environment; their content changes with each call of a
  // non-const method.
  virtual const mjModel_& model() const = 0;
  virtual const mjData_& data() const = 0;
};

}  // namespace myograde::sim
