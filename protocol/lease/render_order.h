// The order for pictures of recorded episodes. Whoever wants them writes it as JSON to the standard
// input of `myograde-render`, which writes the pictures to its standard output (sim/film/README.md).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"

namespace myograde {

struct RenderEpisode {
  // Log files, packed or not. The last one is shown. Where state carries over from one episode to
  // the next, those before it in its lease come first.
  std::vector<std::string> logs;
  std::string title;    // the first line in its pictures; "": none
  std::string verdict;  // shown from the episode's end on; "": none
};

struct RenderOrder {
  enum class Form {
    kFilm,     // raw pictures in sequence, each height x width x 3 bytes (RGB), top row first
    kPicture,  // one PNG of one moment
    kStrip,    // one PNG: a row for each episode, with pictures of moments at equal distances
  };

  TrackConfig track;
  std::string cache_dir;  // models (MYOGRADE_CACHE)
  std::vector<RenderEpisode> episodes;  // one, or for a strip up to kMostStripRows
  Form form = Form::kPicture;
  int width = 320;   // pixels, of each picture
  int height = 180;  // pixels
  bool overlay = true;          // title, time, measurements and verdict in the picture
  std::optional<double> at_s;   // kPicture: the moment in s of simulated time; else the last one
  double frames_per_second = 30;  // kFilm
  double speed = 1;               // kFilm: simulated s in a second of film
  int columns = 5;                // kStrip: pictures in a row
  int threads = 1;                // that draw
  double deadline_s = 3600;       // s of wall time after which the program ends itself
};

inline constexpr int kSmallestRenderSide = 16;    // pixels
inline constexpr int kLargestRenderSide = 4096;   // pixels
inline constexpr double kFilmHoldSeconds = 1.5;   // for which a film shows the last state
inline constexpr int kMostStripRows = 8;
inline constexpr int kMostStripColumns = 16;

nlohmann::json RenderOrderToJson(const RenderOrder& order);

// InvalidArgumentError names the key and its range; unknown keys are errors.
absl::StatusOr<RenderOrder> RenderOrderFromJson(const nlohmann::json& json,
                                                const std::string& where);

// The pictures of a film of an episode with so many logged control steps of `period_s`. REQUIRES:
// steps > 0.
int64_t FilmFrames(const RenderOrder& order, int64_t steps, double period_s);

// The control step, from 1, after which the state of picture `frame` (from 0) of that film is shown.
int64_t StepOfFrame(const RenderOrder& order, int64_t frame, int64_t steps, double period_s);

// The same of the moment of a picture, and of a strip's `column`.
int64_t StepOfMoment(const RenderOrder& order, int64_t steps, double period_s);
int64_t StepOfColumn(const RenderOrder& order, int column, int64_t steps);

// How myograde-render ends.
enum RenderExit : int {
  kRendered = 0,
  kRenderTrouble = 1,    // the host: a model, OSMesa or memory is missing; the order is wrong
  kRenderWrongUse = 2,   // of the command line
  kRenderLogFault = 3,   // a log is damaged, of another config, empty, or plays otherwise than recorded
};

}  // namespace myograde
