// The hand that several models share.
#pragma once

#include "protocol/tracks/hand.h"
#include "sim/model/source.h"

namespace myograde::sim {

inline constexpr int kHandMuscleCount = std::size(kHandMuscles);
inline constexpr int kHandJointCount = std::size(kHandJoints);  // the first of a model of the hand

// Mass properties of its bodies that are made of meshes alone (sim/model/source.h).
inline constexpr Inertial kLunate = {
    "lunate",
    0.1637576853473219,
    {-0.0008863467889798232, -0.009171017944191734, -0.0018690145044945221},
    {0.6528320291339527, 0.4121589181516646, 0.6009868032228728, 0.20676128814854963},
    {0.0001, 0.0001, 0.0001}};
inline constexpr Inertial kCapitate = {
    "capitate",
    0.0018385362329645686,
    {2.4997529376086936e-06, -4.319736123192584e-06, 1.3404175140860993e-06},
    {0.8144622504180147, 0.5615833778524986, -0.12541089135883424, 0.07448127746208164},
    {0.0001, 0.0001, 0.0001}};
inline constexpr Inertial kHandInertials[] = {kLunate, kCapitate};

// A model of the hand with something on its palm, which the main file has. The other files are those
// of hand.sha256.
inline ModelSource HandModel(std::string_view track, std::string_view pins, std::string main_file,
                             absl::Status (*patch)(std::string& main, std::string& actuators)) {
  return {.name = track,
          .pins = pins,
          .main_file = std::move(main_file),
          .actuator_file = "simhive/myo_sim/hand/assets/myohand_assets.xml",
          .inertials = kHandInertials,
          .buffers = {1000, 400, 1'000'000},
          .patch = patch};
}

}  // namespace myograde::sim
