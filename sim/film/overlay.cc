#include "sim/film/overlay.h"

#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

namespace myograde::sim {
namespace {

constexpr size_t kLongestLine = 100;  // characters; MuJoCo's buffer for a text has 500

void AddRow(std::string_view name, std::string_view value, PictureText& text) {
  if (!text.names.empty()) {
    text.names += '\n';
    text.values += '\n';
  }
  text.names.append(name);
  text.values.append(value.substr(0, kLongestLine));
}

std::string Seconds(double time) { return absl::StrFormat("%.2f s", time); }

// How the episode ended; "" before its end.
std::string Ending(const RenderEpisode& episode, const EpisodeLog& log, int64_t step) {
  if (step < log.steps()) return "";
  if (log.end.logged < log.end.steps) {
    return absl::StrCat("the log ends here, after ", log.end.logged, " of ", log.end.steps,
                        " steps");
  }
  const std::string text = episode.verdict.empty() ? "ended: " + log.end.end : episode.verdict;
  return text.substr(0, kLongestLine);
}

}  // namespace

PictureText FilmText(const SimulatedTrack& track, const RenderOrder& order, const EpisodeLog& log,
                     const Environment& environment, int64_t step) {
  const RenderEpisode& episode = order.episodes.front();
  const double period = track.kind->control_period_s;
  PictureText text;
  AddRow("track", absl::StrCat(log.header.track.id, ", ", log.header.track.profile), text);
  AddRow("episode", absl::StrCat(log.header.episode), text);
  AddRow("step", absl::StrCat(step, " of ", log.end.steps), text);
  AddRow("time", Seconds(static_cast<double>(step) * period), text);
  for (const Reading& reading : track.readings(environment.facts())) {
    AddRow(reading.name, reading.value, text);
  }
  if (order.form == RenderOrder::Form::kFilm && order.speed != 1) {
    AddRow("speed", absl::StrFormat("%gx", order.speed), text);
  }
  text.title = episode.title.substr(0, kLongestLine);
  text.caption = Ending(episode, log, step);
  return text;
}

PictureText StripText(const RenderEpisode& episode, const EpisodeLog& log, int column,
                      int64_t step) {
  const double period = log.header.track.kind->control_period_s;
  PictureText text;
  if (column == 0) text.names = episode.title.substr(0, kLongestLine);
  text.title = Seconds(static_cast<double>(step) * period);
  text.caption = Ending(episode, log, step);
  return text;
}

}  // namespace myograde::sim
