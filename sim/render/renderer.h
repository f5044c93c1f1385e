// Pictures of an environment's state, by MuJoCo's renderer without a display.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/render/camera_view.h"
#include "sim/render/picture_text.h"

namespace myograde::sim {

enum class Quality {
  kBest,  // smooth edges and fine shadows
  kFast,  // for films: a third of the time
};

// Draws one model in pictures of one size. Any thread may call it, but one at a time.
class Renderer {
 public:
  static constexpr int kLargestSide = 4096;  // pixels

  // `model` has to outlive the renderer, and may be changed between pictures as environments do
  // (sizes, positions, height fields). InvalidArgumentError: a side is not in [1, kLargestSide].
  // FailedPreconditionError: Mesa's off-screen renderer is not installed.
  static absl::StatusOr<std::unique_ptr<Renderer>> Make(const mjModel& model, int width,
                                                        int height,
                                                        Quality quality = Quality::kBest);
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  int width() const;   // pixels
  int height() const;  // pixels

  // Draws `data`, a state of the model whose positions are up to date (as they are after a step or
  // a reset), and leaves the state as it is. `rgb` gets height x width x 3 bytes, the top row
  // first. InvalidArgumentError: `rgb` has another size, or the model has no such body.
  // `text` is written over it.
  absl::Status Draw(const mjData& data, const CameraView& view, std::span<uint8_t> rgb,
                    const PictureText& text = {});

 private:
  class Implementation;
  explicit Renderer(std::unique_ptr<Implementation> implementation);
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace myograde::sim
