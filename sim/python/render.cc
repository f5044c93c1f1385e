#include <stdlib.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include "sim/python/bindings.h"
#include "sim/render/osmesa.h"
#include "sim/render/renderer.h"

namespace myograde::sim {
namespace {

namespace nb = nanobind;
using nb::literals::operator""_a;  // NOLINT(misc-unused-using-decls): it is, of literals
using Pixels = nb::ndarray<nb::numpy, uint8_t, nb::ndim<3>>;

// A variable of the environment, for as long as this lives.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) {
    if (const char* before = std::getenv(name); before != nullptr) before_ = before;
    ::setenv(name, value, 1);
  }
  ~Variable() {
    if (before_) {
      ::setenv(name_, before_->c_str(), 1);
    } else {
      ::unsetenv(name_);
    }
  }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
  std::optional<std::string> before_;
};

// Mesa reads its variables once, when a process makes its first context. Without threads of its own, for
// drawing and for its cache of shaders, a process that is forked off later can draw, and can end:
// otherwise it waits for threads that a fork leaves behind. Called with Python's lock.
absl::Status StartMesaWithoutThreads() {
  static const absl::Status started = [] {
    const Variable drawing("LP_NUM_THREADS", "0");
    const Variable shaders("MESA_SHADER_CACHE_DISABLE", "true");
    return OsMesaContext::Make(1, 1).status();
  }();
  return started;
}

// Python's Renderer: of one environment, which Python keeps alive.
class EnvironmentRenderer {
 public:
  static std::unique_ptr<EnvironmentRenderer> Make(GradedEnvironment& environment, int width,
                                                   int height) {
    RaiseUnlessOk(StartMesaWithoutThreads());
    absl::StatusOr<std::unique_ptr<Renderer>> renderer;
    {
      nb::gil_scoped_release released;
      const std::lock_guard<std::mutex> alone(environment.mutex());
      renderer = Renderer::Make(environment.environment().model(), width, height);
    }
    RaiseUnlessOk(renderer.status());
    return std::unique_ptr<EnvironmentRenderer>(
        new EnvironmentRenderer(environment, *std::move(renderer)));
  }

  Pixels Draw(const std::optional<std::string>& body,
              const std::optional<std::array<double, 3>>& look_at, std::optional<double> distance,
              std::optional<double> azimuth, std::optional<double> elevation) {
    const auto height = static_cast<size_t>(renderer_->height());
    const auto width = static_cast<size_t>(renderer_->width());
    CameraView view = FindSimulatedTrack(*environment_.config().kind).view;
    if (body) view.body = *body;
    view.look_at = look_at.value_or(view.look_at);
    view.distance_m = distance.value_or(view.distance_m);
    view.azimuth_deg = azimuth.value_or(view.azimuth_deg);
    view.elevation_deg = elevation.value_or(view.elevation_deg);
    auto* rgb = new uint8_t[height * width * 3];
    const nb::capsule owner(rgb, [](void* pixels) noexcept {
      delete[] static_cast<uint8_t*>(pixels);
    });
    absl::Status status;
    {
      nb::gil_scoped_release released;
      const std::lock_guard<std::mutex> alone(environment_.mutex());
      status = renderer_->Draw(environment_.environment().data(), view,
                               {rgb, height * width * 3});
    }
    RaiseUnlessOk(status);
    return Pixels(rgb, {height, width, 3}, owner);
  }

 private:
  EnvironmentRenderer(GradedEnvironment& environment, std::unique_ptr<Renderer> renderer)
      : environment_(environment), renderer_(std::move(renderer)) {}

  GradedEnvironment& environment_;
  std::unique_ptr<Renderer> renderer_;
};

}  // namespace

void BindRender(nb::module_& module) {
  nb::class_<EnvironmentRenderer>(module, "Renderer",
                                  "Draws pictures of an environment, off screen by OSMesa.")
      .def(nb::new_(&EnvironmentRenderer::Make), "environment"_a, "width"_a, "height"_a,
           nb::keep_alive<0, 1>(),
           "Sides in pixels. ValueError: a side is out of range; RuntimeError: OSMesa is missing.")
      .def("draw", &EnvironmentRenderer::Draw, nb::kw_only(), "body"_a = nb::none(),
           "look_at"_a = nb::none(), "distance"_a = nb::none(), "azimuth"_a = nb::none(),
           "elevation"_a = nb::none(),
           "The current state, height x width x 3 uint8, as a new array. None: as the track's own "
           "camera (m, degrees).");
}

}  // namespace myograde::sim
