// Where a hand is, by the angles of its arm, and which angles bring it to a pose: the chain of
// bodies from the world to the grasp point of the muscle arm or of the prosthesis.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <span>
#include <vector>

namespace myograde::baseline {

inline constexpr int kChainAngles = 7;  // of shoulder, elbow, forearm and wrist

using ChainAngles = std::array<double, kChainAngles>;  // rad

struct Pose {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();  // m, in the world
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
};

// A hinge at its link's origin. Several of one arm turn by the same angle (the scapula follows the
// shoulder's elevation), each times its ratio.
struct Hinge {
  int angle;
  double ratio;
  Eigen::Vector3d axis;  // in the link's frame
};

struct Link {
  Eigen::Vector3d place;  // m, in the frame of the link before
  Eigen::Quaterniond turn;
  std::vector<Hinge> hinges;                          // the first one is the outermost
  double mass = 0;                                    // kg
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();   // m, of the mass, in the link's frame
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  // kg m^2 around that, about the frame's axes
};

using ChainInertia = Eigen::Matrix<double, kChainAngles, kChainAngles>;  // kg m^2

struct AngleRange {
  double low, high;  // rad
};

inline constexpr ChainAngles kAllEasy = {1, 1, 1, 1, 1, 1, 1};

class Chain {
 public:
  // `grasp`: where the hand grasps, in the frame of the last link, in m.
  Chain(std::vector<Link> links, Eigen::Vector3d grasp, std::array<AngleRange, kChainAngles> ranges)
      : links_(std::move(links)), grasp_(grasp), ranges_(ranges) {}

  // The grasp point and the last link's orientation.
  Pose Of(const ChainAngles& angles) const;

  // The inertia that the angles' accelerations meet.
  ChainInertia Inertia(const ChainAngles& angles) const;

  // One damped least-squares step (Nakamura and Hanafusa 1986) from `angles` towards `goal`,
  // within the ranges. A radian of orientation counts as `turn_weight` m; nothing holds the
  // orientation at 0. `rest`, towards which what is left free goes. `ease`: how readily each angle
  // is used.
  ChainAngles Nearer(const ChainAngles& angles, const Pose& goal, double turn_weight,
                     const ChainAngles& rest, const ChainAngles& ease = kAllEasy) const;

 private:
  std::vector<Link> links_;
  Eigen::Vector3d grasp_;
  std::array<AngleRange, kChainAngles> ranges_;
};

// Elevation plane, elevation and rotation of the shoulder, elbow, pronation, deviation and flexion
// of the wrist; the grasp point is the model's site S_grasp.
const Chain& MuscleArm();

// The servos' joints in their order: flexion, abduction and rotation of the shoulder, elbow,
// pronation, deviation and flexion of the wrist; the grasp point is before the middle of the palm.
const Chain& ProstheticArm();

}  // namespace myograde::baseline
