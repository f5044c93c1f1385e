// What a track says of its model: which files of the package it is made of, and what has to be
// changed in them so that MuJoCo 2.2.2 follows the official 3.1.2 (sim/README.md).
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde::sim {

// Mass properties of a body that is made of meshes alone. MuJoCo 2.2.2 and 3.1.2 integrate meshes
// differently; these are the values that 3.1.2 computes, so that a model compiled here weighs what
// the official environments' does.
struct Inertial {
  const char* body;                // name in the model
  double mass;                     // kg
  std::array<double, 3> position;  // m, centre of mass in the body's frame
  std::array<double, 4> rotation;  // w, x, y, z: principal axes in the body's frame
  std::array<double, 3> inertia;   // kg m^2, principal
};

// Buffers of mjData. The XML files ask for enough to fill hundreds of
// megabytes; these are several times what the models were ever seen to use.
// An overflow is reported by the environment as the grader's fault.
struct Buffers {
  int constraints;
  int contacts;
  int stack;  // doubles
};

struct ModelSource {
  std::string_view name;  // of its compiled file
  std::string_view pins;  // lines of "SHA-256  path in the package"
  std::string main_file;
  std::string actuator_file;
  std::span<const Inertial> inertials;
  Buffers buffers;
  // Changes the text of the two files; null: nothing needs to be.
  absl::Status (*patch)(std::string& main, std::string& actuators) = nullptr;
};

// Tools for patches. Each tells as an InternalError what it did not find.

// Cuts the one `begin`...`end` piece out of `text` and returns it.
absl::StatusOr<std::string> Cut(std::string& text, const std::string& begin,
                                const std::string& end);
absl::Status InsertBefore(std::string& text, const std::string& marker, const std::string& piece);

}  // namespace myograde::sim
