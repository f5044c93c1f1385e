// What a track adds to the trajectories of its episodes: curves, events, and sizes that differ between
// episodes.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::sim {

class Environment;

// A curve below a replay.
struct Series {
  std::string_view name;   // its key
  std::string_view title;  // for people
  std::string_view unit;   // "": it has none
  // Not empty: a value is the index of one of these, at most 255.
  std::span<const std::string_view> labels = {};
  // Drawn in the graph of the series of this name; "": in one of its own.
  std::string_view graph = {};
};

struct TrajectoryEvent {
  double time_s = 0;  // of the episode
  std::string kind;   // a word of README.md's table
  std::string text;   // for people
  std::optional<double> value = {};
  std::string unit = {};  // of the value
};

// Where a body should be: a viewer draws its shapes there as well.
struct TargetPose {
  int body = -1;                         // of the model
  std::array<double, 3> position = {};   // m, in the world
  std::array<double, 4> rotation = {};   // w, x, y, z
};

// Looks on while one environment plays one episode.
class Telemetry {
 public:
  virtual ~Telemetry() = default;

  virtual std::span<const Series> series() const = 0;

  // The series' values in the state after the last reset or step; `out` has an entry for each.
  virtual void Sample(std::span<double> out) const = 0;

  // The targets now that no body of the model shows; of the same bodies each time.
  virtual std::vector<TargetPose> Targets() const { return {}; }

  // How far from a series what should follow it may be, in its unit; 0: it is no target.
  virtual double ToleranceOf(std::string_view series) const {
    (void)series;
    return 0;
  }

  // The episode was reset, or a step was played and it is `time_s` now: appends what happened then.
  virtual void Begin() {}
  virtual void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) = 0;
  // The episode is over: appends what is known only now, at whatever time it was.
  virtual void AtEnd(double time_s, std::vector<TrajectoryEvent>& events) {
    (void)time_s, (void)events;
  }

  // For people, in a sentence: what of the scene is not told by its look. "": nothing.
  virtual std::string_view Legend() const { return {}; }

  // How much larger than in the model a body is in this episode, along its axes.
  virtual std::array<double, 3> ScaleOf(int body) const {
    (void)body;
    return {1, 1, 1};
  }
};

// Tells when a target is reached and when it is left again.
class TargetEvents {
 public:
  // `reached`: whether it is at `time_s` (s); before the first call it is not.
  void Add(bool reached, double time_s, const char* when_reached, const char* when_left,
           std::vector<TrajectoryEvent>& events) {
    if (reached == reached_) return;
    reached_ = reached;
    events.push_back({time_s, "target", reached ? when_reached : when_left});
  }

 private:
  bool reached_ = false;
};

// REQUIRES: an environment of the track, which outlives the telemetry.
using MakeTelemetry = std::unique_ptr<Telemetry> (*)(const Environment& environment);

}  // namespace myograde::sim
