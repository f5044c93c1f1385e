// Carries out orders for pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/lease/render_order.h"
#include "sim/environment.h"
#include "sim/film/recording.h"
#include "sim/render/renderer.h"
#include "sim/tracks.h"

namespace myograde::sim {

class Sheet;  // the pictures of a strip

// What an order needs, in two parts, so that a system call filter can be set between them.
class Renders {
 public:
  // Loads models and OpenGL, and opens the logs. Errors of MakeEnvironment, Renderer::Make and
  // Recording::Open.
  static absl::StatusOr<Renders> Prepare(RenderOrder order);

  // Reads the logs, plays them and writes the pictures to the descriptor `out`. DataLossError: a log
  // can't be shown. InternalError: the pictures can't be drawn or written.
  absl::Status Write(int out);

 private:
  // State may carry over from one episode to the next, so those that play the same logs first share
  // an environment, in which these are played once.
  struct Stage {
    std::unique_ptr<Environment> environment;
    std::unique_ptr<Renderer> renderer;
    Recording recording;
  };
  // Where an episode of the order is played: the last of its logs is `log` of that stage.
  struct Place {
    size_t stage = 0;
    size_t log = 0;
  };

  Renders(RenderOrder order, const SimulatedTrack& track)
      : order_(std::move(order)), track_(&track) {}
  absl::Status WriteFilm(int out);
  absl::Status WritePicture(int out);
  absl::Status WriteStrip(int out);
  absl::Status Draw(Stage& stage, const PictureText& text);
  absl::Status Open(const RenderEpisode& episode, Place& place);
  const EpisodeLog& Shown(const Place& place) const {
    return stages_[place.stage].recording.log(place.log);
  }
  absl::Status DrawRow(size_t row, int64_t step, int& column, Sheet& sheet);

  RenderOrder order_;
  const SimulatedTrack* track_;
  std::vector<Stage> stages_;
  std::vector<Place> places_;  // by episode of the order
  std::vector<uint8_t> rgb_;  // the last picture
};

}  // namespace myograde::sim
