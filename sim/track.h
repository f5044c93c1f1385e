// What the simulator has of a track, from its folder sim/<track>/, and what tracks make it with.
#pragma once

#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "sim/environment.h"
#include "sim/model/model.h"
#include "sim/model/official_steps.h"
#include "sim/model/source.h"
#include "sim/reading.h"
#include "sim/render/camera_view.h"
#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

struct SimulatedTrack {
  const TrackKind* kind;
  const ModelSource* model;
  CameraView view;  // of pictures, unless another is asked for
  absl::StatusOr<std::unique_ptr<Environment>> (*make)(const TrackConfig& config,
                                                       const std::string& cache_dir);
  std::span<const RewardTerm> reward_terms;  // in the order of Environment::RewardTerms
  std::vector<Reading> (*readings)(const EpisodeFacts& episode);  // of the episode so far
  MakeTelemetry telemetry;                                        // of one of its environments
};

// Where a config's rules are, for errors.
inline std::string RulesPlace(const TrackConfig& config) {
  return absl::StrCat(config.id, ", profile ", config.profile, ": rules");
}

// A SimulatedTrack::make: `parse` reads the config's rules, and Env::Make makes the environment of
// them and of the model that `source` tells. Errors: the rules are wrong (InvalidArgumentError), or
// the model can't be loaded (see LoadModel).
template <typename Env, auto parse, auto source>
absl::StatusOr<std::unique_ptr<Environment>> MakeOf(const TrackConfig& config,
                                                    const std::string& cache_dir) {
  ASSIGN_OR_RETURN(const auto rules, parse(config.rules, RulesPlace(config)));
  ASSIGN_OR_RETURN(ModelPtr model, LoadModel(source(), cache_dir));
  return Env::Make(rules, std::move(model));
}

// A SimulatedTrack::readings: what `of` makes of the track's facts and of the number of steps, 1 at
// least, and the mean effort. Empty if the facts are of another track.
template <typename Facts, auto of>
std::vector<Reading> ReadingsOf(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<Facts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  std::vector<Reading> readings = of(*facts, steps);
  readings.push_back({"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)});
  return readings;
}

// A SimulatedTrack::telemetry: a TelemetryOf. REQUIRES: an environment of its class.
template <typename Watch>
std::unique_ptr<Telemetry> WatchBy(const Environment& environment) {
  return std::make_unique<Watch>(environment);
}

// The telemetry of environments of one class, whose curves are the table `curves`.
template <typename Env, const auto& curves>
class TelemetryOf : public Telemetry {
 public:
  explicit TelemetryOf(const Environment& environment)
      : environment_(static_cast<const Env&>(environment)) {}

  std::span<const Series> series() const final { return curves; }
  void Sample(std::span<double> out) const final { std::ranges::copy(Values(), out.begin()); }

 protected:
  // As Sample.
  virtual std::array<double, std::size(curves)> Values() const = 0;

  const mjModel& model() const { return environment_.model(); }
  const mjData& data() const { return environment_.data(); }
  double Effort() const { return MuscleEffort(model(), data()); }

  const Env& environment_;
};

}  // namespace myograde::sim
