#include "sim/film/renders.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "sim/film/overlay.h"
#include "sim/film/png.h"

namespace myograde::sim {
namespace {

constexpr int kGap = 4;  // pixels between the pictures of a strip
constexpr uint8_t kPaper = 255;

absl::Status WriteOut(int out, std::string_view bytes) {
  const absl::Status status = WriteAll(out, bytes);
  if (status.ok()) return status;
  return absl::InternalError(absl::StrCat("can't write the pictures: ", status.message()));
}

absl::Status WriteOut(int out, std::span<const uint8_t> bytes) {
  return WriteOut(out, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

absl::Status WritePng(int out, std::span<const uint8_t> rgb, int width, int height) {
  const absl::StatusOr<std::string> png = EncodePng(rgb, width, height);
  return png.ok() ? WriteOut(out, *png) : png.status();
}

}  // namespace

// Pictures of one size in rows and columns.
class Sheet {
 public:
  Sheet(int columns, int rows, int width, int height)
      : tile_width_(width),
        tile_height_(height),
        width_(columns * (width + kGap) - kGap),
        height_(rows * (height + kGap) - kGap),
        rgb_(static_cast<size_t>(width_) * static_cast<size_t>(height_) * 3, kPaper) {}

  int width() const { return width_; }
  int height() const { return height_; }
  std::span<const uint8_t> rgb() const { return rgb_; }

  void Put(int column, int row, std::span<const uint8_t> tile) {
    const size_t bytes = static_cast<size_t>(tile_width_) * 3;
    for (int line = 0; line < tile_height_; ++line) {
      const int y = row * (tile_height_ + kGap) + line;
      const int x = column * (tile_width_ + kGap);
      const auto from = tile.subspan(static_cast<size_t>(line) * bytes, bytes);
      const size_t at = (static_cast<size_t>(y) * static_cast<size_t>(width_) +
                         static_cast<size_t>(x)) * 3;
      std::ranges::copy(from, rgb_.begin() + static_cast<std::ptrdiff_t>(at));
    }
  }

 private:
  int tile_width_, tile_height_, width_, height_;
  std::vector<uint8_t> rgb_;
};

absl::StatusOr<Renders> Renders::Prepare(RenderOrder order) {
  const SimulatedTrack& track = FindSimulatedTrack(*order.track.kind);
  Renders renders(std::move(order), track);
  const RenderOrder& wanted = renders.order_;
  // The longest first: others may be a part of them.
  std::vector<size_t> by_length(wanted.episodes.size());
  std::iota(by_length.begin(), by_length.end(), size_t{0});
  std::ranges::stable_sort(by_length, std::greater(), [&](size_t episode) {
    return wanted.episodes[episode].logs.size();
  });
  renders.places_.resize(wanted.episodes.size());
  for (const size_t i : by_length) {
    RETURN_IF_ERROR(renders.Open(wanted.episodes[i], renders.places_[i]));
  }
  renders.rgb_.resize(static_cast<size_t>(wanted.width) * static_cast<size_t>(wanted.height) * 3);
  return renders;
}

absl::Status Renders::Open(const RenderEpisode& episode, Place& place) {
  place.log = episode.logs.size() - 1;
  for (place.stage = 0; place.stage < stages_.size(); ++place.stage) {
    if (stages_[place.stage].recording.BeginsWith(episode.logs)) return absl::OkStatus();
  }
  const Quality quality =
      order_.form == RenderOrder::Form::kFilm ? Quality::kFast : Quality::kBest;
  ASSIGN_OR_RETURN(auto recording, Recording::Open(episode.logs));
  ASSIGN_OR_RETURN(auto environment, MakeEnvironment(order_.track, order_.cache_dir));
  ASSIGN_OR_RETURN(auto renderer,
                   Renderer::Make(environment->model(), order_.width, order_.height, quality));
  stages_.push_back({std::move(environment), std::move(renderer), std::move(recording)});
  return absl::OkStatus();
}

absl::Status Renders::Write(int out) {
  for (Stage& stage : stages_) {
    RETURN_IF_ERROR(stage.recording.Read(order_.track));
  }
  for (const Place& place : places_) {
    const EpisodeLog& log = Shown(place);
    if (log.steps() > 0) continue;
    return absl::DataLossError(absl::StrCat("episode ", log.header.episode,
                                            " has no step to show: it ended by \"", log.end.end,
                                            "\" before the first"));
  }
  switch (order_.form) {
    case RenderOrder::Form::kFilm: return WriteFilm(out);
    case RenderOrder::Form::kPicture: return WritePicture(out);
    case RenderOrder::Form::kStrip: return WriteStrip(out);
  }
  return absl::InternalError("an order of an unknown form");
}

absl::Status Renders::Draw(Stage& stage, const PictureText& text) {
  return stage.renderer->Draw(stage.environment->data(), track_->view, rgb_,
                              order_.overlay ? text : PictureText());
}

absl::Status Renders::WriteFilm(int out) {
  Stage& stage = stages_.front();
  const EpisodeLog& log = Shown(places_.front());
  const double period = track_->kind->control_period_s;
  const int64_t frames = FilmFrames(order_, log.steps(), period);
  int64_t frame = 0;
  return stage.recording.Play(*stage.environment, [&](size_t played, int64_t step) {
    const auto due = [&] {
      return played == places_.front().log && frame < frames &&
             StepOfFrame(order_, frame, log.steps(), period) == step;
    };
    if (!due()) return absl::OkStatus();
    absl::Status status = Draw(stage, FilmText(*track_, order_, log, *stage.environment, step));
    // In slow motion several pictures show the same state.
    for (; status.ok() && due(); ++frame) status = WriteOut(out, rgb_);
    return status;
  });
}

absl::Status Renders::WritePicture(int out) {
  Stage& stage = stages_.front();
  const EpisodeLog& log = Shown(places_.front());
  const int64_t moment = StepOfMoment(order_, log.steps(), track_->kind->control_period_s);
  const auto on_step = [&](size_t played, int64_t step) {
    if (played != places_.front().log || step != moment) return absl::OkStatus();
    return Draw(stage, FilmText(*track_, order_, log, *stage.environment, step));
  };
  const absl::Status drawn = stage.recording.Play(*stage.environment, on_step);
  return drawn.ok() ? WritePng(out, rgb_, order_.width, order_.height) : drawn;
}

absl::Status Renders::DrawRow(size_t row, int64_t step, int& column, Sheet& sheet) {
  const EpisodeLog& log = Shown(places_[row]);
  while (column < order_.columns && StepOfColumn(order_, column, log.steps()) == step) {
    const PictureText text = StripText(order_.episodes[row], log, column, step);
    RETURN_IF_ERROR(Draw(stages_[places_[row].stage], text));
    sheet.Put(column++, static_cast<int>(row), rgb_);
  }
  return absl::OkStatus();
}

absl::Status Renders::WriteStrip(int out) {
  Sheet sheet(order_.columns, static_cast<int>(places_.size()), order_.width, order_.height);
  std::vector<int> columns(places_.size(), 0);  // the next to draw, by row
  for (size_t s = 0; s < stages_.size(); ++s) {
    const auto on_step = [&](size_t played, int64_t step) {
      for (size_t row = 0; row < places_.size(); ++row) {
        if (places_[row].stage != s || places_[row].log != played) continue;
        RETURN_IF_ERROR(DrawRow(row, step, columns[row], sheet));
      }
      return absl::OkStatus();
    };
    RETURN_IF_ERROR(stages_[s].recording.Play(*stages_[s].environment, on_step));
  }
  return WritePng(out, sheet.rgb(), sheet.width(), sheet.height());
}

}  // namespace myograde::sim
