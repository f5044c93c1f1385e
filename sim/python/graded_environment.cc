#include "sim/python/graded_environment.h"

#include <cmath>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::sim {
namespace {

// Entries of actions that an environment keeps so that it can be copied: 64 MiB.
constexpr size_t kLargestHistory = size_t{8} << 20;

}  // namespace

absl::StatusOr<TrackConfig> ConfigOf(const EnvironmentOptions& options) {
  if (options.config_file.empty()) {
    return LoadTrackConfig(options.tracks_dir, options.track, options.profile);
  }
  ASSIGN_OR_RETURN(nlohmann::json file, ReadJsonFile(options.config_file));
  return ResolveTrackConfig(options.tracks_dir, options.track, options.profile, file,
                            options.config_file);
}

absl::StatusOr<std::unique_ptr<GradedEnvironment>> GradedEnvironment::Make(
    const EnvironmentOptions& options) {
  ASSIGN_OR_RETURN(TrackConfig config, ConfigOf(options));
  if (options.extra_observations && !config.extra_observations) {
    return absl::InvalidArgumentError(
        absl::StrCat("track ", config.id, " has no extra observations in its profile ",
                     config.profile, ", so a policy can't use them there"));
  }
  ASSIGN_OR_RETURN(auto environment, MakeEnvironment(config, options.cache_dir));
  return std::unique_ptr<GradedEnvironment>(
      new GradedEnvironment(std::move(config), std::move(environment), options));
}

GradedEnvironment::GradedEnvironment(TrackConfig config, std::unique_ptr<Environment> environment,
                                     const EnvironmentOptions& options)
    : config_(std::move(config)),
      environment_(std::move(environment)),
      convention_(options.convention),
      extra_(options.extra_observations),
      carries_over_(config_.rules.value("one_environment", false)),
      max_steps_(options.max_steps) {}

absl::Status GradedEnvironment::Reset(uint64_t seed, const nlohmann::json& parameters) {
  if (!carries_over_) {
    history_.clear();
    history_size_ = 0;
  }
  history_.push_back({.seed = seed, .parameters = parameters, .actions = {}});
  environment_->Reset(seed);
  environment_->SetConvention(convention_);
  digests_ = EpisodeDigests();
  seed_ = seed;
  steps_ = 0;
  running_ = terminated_ = truncated_ = unstable_ = false;
  if (!parameters.empty()) RETURN_IF_ERROR(environment_->SetParameters(parameters));
  running_ = true;
  return absl::OkStatus();
}

absl::Status GradedEnvironment::CheckAction(std::span<const double> action) const {
  if (static_cast<int>(action.size()) != action_size()) {
    return absl::InvalidArgumentError(absl::StrCat("an action must have ", action_size(),
                                                   " entries, but this one has ", action.size()));
  }
  for (size_t i = 0; i < action.size(); ++i) {
    if (std::isfinite(action[i])) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("entry ", i, " of the action is ", action[i],
                     "; every entry must be a finite number"));
  }
  return absl::OkStatus();
}

absl::Status GradedEnvironment::Step(std::span<const double> action) {
  if (!running_) {
    return absl::FailedPreconditionError("there is no episode; call reset() first");
  }
  history_size_ += action.size();
  std::vector<double>& kept = history_.back().actions;
  if (history_size_ > kLargestHistory) {
    kept.clear();
  } else {
    kept.insert(kept.end(), action.begin(), action.end());
  }
  const StepResult result = environment_->Step(action);
  digests_.Step(action, environment_->state());
  ++steps_;
  if (result.overflow) {
    running_ = false;
    return absl::InternalError(
        absl::StrCat("a contact or constraint buffer was too small in step ", steps_ - 1,
                     " of the episode with seed ", seed_, "; reset() begins another"));
  }
  unstable_ = result.unstable;
  truncated_ = result.ended && !unstable_ && environment_->facts().end == EpisodeEnd::kTime;
  terminated_ = (result.ended || unstable_) && !truncated_;
  truncated_ = truncated_ || (!terminated_ && max_steps_ > 0 && steps_ >= max_steps_);
  running_ = !terminated_ && !truncated_;
  return absl::OkStatus();
}

absl::StatusOr<std::vector<EpisodeInputs>> GradedEnvironment::History() const {
  if (history_size_ <= kLargestHistory) return history_;
  return absl::ResourceExhaustedError(
      "this environment can't be copied: in its profile, its state depends on all episodes since "
      "it was created, which are too many; create another one with the same arguments");
}

absl::Status GradedEnvironment::Restore(std::span<const EpisodeInputs> history) {
  for (const EpisodeInputs& episode : history) {
    // An episode that ended by an error ended by the same error when it was first played.
    (void)Reset(episode.seed, episode.parameters);
    const auto size = static_cast<size_t>(action_size());
    if (episode.actions.size() % size != 0) {
      return absl::InvalidArgumentError("the state is of another environment");
    }
    for (size_t i = 0; i < episode.actions.size() && running_; i += size) {
      const std::span<const double> action = std::span(episode.actions).subspan(i, size);
      RETURN_IF_ERROR(CheckAction(action));
      (void)Step(action);
    }
  }
  return absl::OkStatus();
}

void GradedEnvironment::Observe(std::span<double> out) const {
  const auto graded = static_cast<size_t>(environment_->observation_size());
  environment_->Observe(out.first(graded));
  if (extra_) environment_->ObserveExtra(out.subspan(graded));
}

int GradedEnvironment::observation_size() const {
  return environment_->observation_size() + (extra_ ? ExtraOf(*config_.kind).size() : 0);
}

std::span<const RewardTerm> GradedEnvironment::reward_terms() const {
  return FindSimulatedTrack(*config_.kind).reward_terms;
}

EpisodeFacts GradedEnvironment::facts() const {
  EpisodeFacts facts = environment_->facts();
  facts.seed = seed_;
  facts.digest = digest();
  facts.actions_digest = actions_digest();
  return facts;
}

}  // namespace myograde::sim
