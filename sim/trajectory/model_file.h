// The model file of a track (README.md): its shapes for viewers, as binary glTF.
#pragma once

#include <string>
#include <string_view>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/model/source.h"
#include "sim/render/camera_view.h"

namespace myograde::sim {

inline constexpr size_t kMostModelFileBytes = 1'000'000;

// Identifies the model file of a track: 16 hexadecimal digits, other ones for other sources, patches
// or contents of the file.
std::string ModelFileKey(const ModelSource& source);

// The file's bytes, at most kMostModelFileBytes: the same for the same arguments. Errors: as BuildFigure;
// ResourceExhaustedError: it has too many shapes.
absl::StatusOr<std::string> MakeModelFile(const mjModel& model, std::string_view track,
                                          const std::string& key, const CameraView& view);

}  // namespace myograde::sim
