// An environment as it is stepped without an episode loop: by people who train a policy. What it
// plays, and the digests of it, are those of a graded episode with the same seed and actions.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "sim/environment.h"
#include "sim/episode/digests.h"
#include "sim/tracks.h"

namespace myograde::sim {

struct EnvironmentOptions {
  std::string tracks_dir;   // folder of track configs
  std::string track;        // name of a config in it
  std::string profile;      // "": the config's default
  std::string config_file;  // a config that replaces that of `track`; "": none
  std::string cache_dir;    // models (MYOGRADE_CACHE)
  ActionConvention convention = ActionConvention::kNormalized;
  bool extra_observations = false;
  int64_t max_steps = 0;    // the caller's own limit of an episode, in control steps; 0: none
};

// What was given to an episode so far. Played again, it leads to the same state, to the bit.
struct EpisodeInputs {
  uint64_t seed = 0;
  nlohmann::json parameters = nlohmann::json::object();
  std::vector<double> actions;  // action_size() entries a step
};

// The effective config that the options name. Errors as LoadTrackConfig.
absl::StatusOr<TrackConfig> ConfigOf(const EnvironmentOptions& options);

// Not thread-safe; mutex() is for callers that may be called from several threads.
class GradedEnvironment {
 public:
  // Errors: the config or its rules are wrong, it allows no extra observations where they are asked
  // for (InvalidArgumentError), or the model can't be loaded.
  static absl::StatusOr<std::unique_ptr<GradedEnvironment>> Make(const EnvironmentOptions& options);

  // Begins the episode of `seed` with these parameters of the track (Environment::SetParameters).
  // InvalidArgumentError names a number in them that is out of range; there is no episode then.
  absl::Status Reset(uint64_t seed, const nlohmann::json& parameters);

  // OK, or the sentence that says what is wrong with the action: its size or a number that is not
  // finite.
  absl::Status CheckAction(std::span<const double> action) const;

  // Plays one control step. FailedPreconditionError if no episode runs; InternalError if a buffer of
  // the simulation was too small, which ends the episode. REQUIRES: CheckAction(action) is OK.
  absl::Status Step(std::span<const double> action);

  // What led to the current state: the current episode, after those whose state carries over to it.
  // Empty before the first Reset. ResourceExhaustedError if they are too long to be kept.
  absl::StatusOr<std::vector<EpisodeInputs>> History() const;
  // Plays a history of an environment with the same options. InvalidArgumentError if it is none.
  absl::Status Restore(std::span<const EpisodeInputs> history);

  // Writes observation_size() entries: the graded observation, then the extra ones if they are on.
  void Observe(std::span<double> out) const;
  // Writes an entry for each of reward_terms().
  void RewardTerms(std::span<double> out) const { environment_->RewardTerms(out); }

  int observation_size() const;
  int action_size() const { return environment_->action_size(); }
  std::span<const RewardTerm> reward_terms() const;
  const TrackConfig& config() const { return config_; }
  bool extra_observations() const { return extra_; }
  ActionConvention convention() const { return convention_; }
  const Environment& environment() const { return *environment_; }

  // Of the episode. `terminated`: it came to an end by itself; `truncated`: its time ran out.
  bool running() const { return running_; }
  bool terminated() const { return terminated_; }
  bool truncated() const { return truncated_; }
  bool unstable() const { return unstable_; }  // the physics gave bad numbers, which ended it
  uint64_t seed() const { return seed_; }
  int64_t steps() const { return steps_; }
  EpisodeFacts facts() const;
  // EpisodeFacts::digest and actions_digest of the steps so far.
  std::string digest() const { return ToHex(digests_.PeekStates()); }
  std::string actions_digest() const { return ToHex(digests_.PeekActions()); }

  std::mutex& mutex() { return mutex_; }

 private:
  GradedEnvironment(TrackConfig config, std::unique_ptr<Environment> environment,
                    const EnvironmentOptions& options);

  const TrackConfig config_;
  const std::unique_ptr<Environment> environment_;
  const ActionConvention convention_;
  const bool extra_;
  const bool carries_over_;  // an episode's state depends on those before it
  const int64_t max_steps_;
  std::mutex mutex_;

  std::vector<EpisodeInputs> history_;
  size_t history_size_ = 0;  // actions' entries in it

  EpisodeDigests digests_;
  uint64_t seed_ = 0;
  int64_t steps_ = 0;
  bool running_ = false;
  bool terminated_ = false;
  bool truncated_ = false;
  bool unstable_ = false;
};

}  // namespace myograde::sim
