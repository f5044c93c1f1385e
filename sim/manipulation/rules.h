// The manipulation environment's numbers and switches: the "rules" object of a
// profile in configs/tracks/. One implementation reads them all; a profile is
// nothing but a set of values. Lengths in m, times in s, masses in kg.
#pragma once

#include <cstdint>
#include <string>

#include <Eigen/Core>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde {

struct ManipulationRules {
  enum class EndRule {
    kPlaced,  // "placed": in the goal area, touching the goal alone, for hold_frames frames
    kSolved,  // "solved": the official flag
  };
  // Which point of the object is its place where the profile judges placement and drops.
  enum class ObjectPoint { kBoxCentre, kTouchSite };
  // What bodies that are no limb count as when the object touches them.
  enum class CountsAs { kOther, kArm };
  // The object's inertia: of a solid box of the drawn size and mass, or the model's own.
  enum class Inertia { kSolidBox, kModel };

  // The episode's end.
  int64_t max_steps;   // control steps
  double max_time_s;   // ends after the step whose simulated time is above it
  double drop_height_m;
  EndRule end_rule;
  ObjectPoint object_point;

  // Drawn per episode, uniformly within centre +- spread on each axis.
  Eigen::Vector3d start_centre_m, start_spread_m;
  Eigen::Vector3d goal_centre_m, goal_spread_m;
  double release_height_m;  // the object starts this far above the start position
  double mass_kg, mass_spread_kg;
  Eigen::Vector3d friction, friction_spread;  // sliding, torsional, rolling
  Eigen::Vector3d half_size_m, size_spread;   // the spread is relative to the size
  Inertia inertia;

  // Placement.
  double goal_face_m;         // height of the goal pillar's top face
  double placed_axis_m;       // largest distance from the face's centre on each axis
  int64_t hold_frames;        // frames in a row of placement and of goal-only contact
  double solved_distance_m;   // official flag: distance of the touch site ...
  int64_t solved_goal_frames;  // ... and frames with goal contact so far

  // Contact.
  CountsAs world_contact;  // floor and stage
  CountsAs torso_contact;  // what the arm hangs on: everything above the clavicle
  bool count_reset_frame;  // the reset's observation is a frame of the contact history

  // One environment plays all episodes of a lease: the random stream goes on from
  // episode to episode, only the first seed counts.
  bool one_environment;

  // The official environment's defects, each on or off (README.md lists them).
  bool peak_touch_survives_reset;   // with one_environment
  bool size_fixed_on_first_reset;
  bool bounding_radius_fixed;
  bool stale_first_observation;
  bool end_lags_solved;
  bool actions_unclipped;
  bool warnings_reset_simulation;
  bool phantom_trials;              // with one_environment
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<ManipulationRules> ParseManipulationRules(const nlohmann::json& rules,
                                                         const std::string& where);

}  // namespace myograde
