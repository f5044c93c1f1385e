// The moving parts of a model, as trajectories and model files both list them.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

namespace myograde::sim {

// A point on a muscle's path that is fixed to a body, or a shape that the muscle may wrap around.
struct PathPoint {
  int part = -1;                   // index into Figure::parts; -1: the world
  std::array<double, 3> at = {};   // m, in the part's frame; not of a wrap
  int wrap = -1;                   // index into Figure::wraps; -1: it is fixed
};

struct MusclePath {
  std::string name;    // of the actuator
  int tendon = -1;     // in the model
  int activation = 0;  // index into mjData::act
  double radius = 0;   // m
  std::vector<PathPoint> points;
};

struct WrapShape {
  int geom = -1;  // in the model
  int part = -1;  // as PathPoint::part
};

// What of a model can move on its own, or is placed anew by each reset. What is welded onto a body
// moves with it and is not a part of its own.
struct Figure {
  std::vector<int> parts;    // bodies, ascending
  std::vector<int> part_of;  // for each body its part's index; -1: fixed in the world
  std::vector<int> from;     // for each part the earlier part that its position is told from; -1: none
  std::vector<MusclePath> muscles;  // in the order of their activations
  std::vector<WrapShape> wraps;
};

// InvalidArgumentError: a muscle's path is of a kind that trajectories can't show, or a part has no
// name.
absl::StatusOr<Figure> BuildFigure(const mjModel& model);

// The pose of a body's frame in the frame of the part that it belongs to, or in the world's.
struct RelativePose {
  std::array<double, 3> position;
  std::array<double, 4> rotation;  // w, x, y, z
};
RelativePose PoseInPart(const mjModel& model, const Figure& figure, int body);

// A point of a body in the frame of its part, or of the world.
std::array<double, 3> PointInPart(const mjModel& model, const Figure& figure, int body,
                                  const mjtNum point[3]);

}  // namespace myograde::sim
