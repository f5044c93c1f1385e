#include "protocol/lease/render_order.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

constexpr int kMostRenderThreads = 64;
constexpr double kLongestRender = 7 * 86400;  // s

const std::vector<std::string> kForms = {"film", "picture", "strip"};

Json EpisodeToJson(const RenderEpisode& episode) {
  return {{"logs", episode.logs}, {"title", episode.title}, {"verdict", episode.verdict}};
}

absl::StatusOr<std::vector<RenderEpisode>> ReadRenderEpisodes(const Json& array,
                                                              const std::string& where) {
  std::vector<RenderEpisode> episodes;
  for (const Json& entry : array) {
    ConfigReader reader(entry, absl::StrCat(where, ": episodes[", episodes.size(), "]"));
    RenderEpisode episode;
    episode.logs = reader.Strings("logs");
    episode.title = reader.String("title");
    episode.verdict = reader.String("verdict");
    if (episode.logs.empty()) reader.Fail("logs", "must name at least one file");
    RETURN_IF_ERROR(reader.Finish());
    episodes.push_back(std::move(episode));
  }
  return episodes;
}

}  // namespace

nlohmann::json RenderOrderToJson(const RenderOrder& order) {
  Json episodes = Json::array();
  for (const RenderEpisode& episode : order.episodes) episodes.push_back(EpisodeToJson(episode));
  return {{"track", order.track.effective},
          {"cache_dir", order.cache_dir},
          {"episodes", std::move(episodes)},
          {"form", kForms[static_cast<size_t>(order.form)]},
          {"width", order.width},
          {"height", order.height},
          {"overlay", order.overlay},
          {"at_s", order.at_s.has_value() ? Json(*order.at_s) : Json()},
          {"frames_per_second", order.frames_per_second},
          {"speed", order.speed},
          {"columns", order.columns},
          {"threads", order.threads},
          {"deadline_s", order.deadline_s}};
}

absl::StatusOr<RenderOrder> RenderOrderFromJson(const nlohmann::json& json,
                                                const std::string& where) {
  ConfigReader reader(json, where);
  RenderOrder order;
  order.cache_dir = reader.String("cache_dir");
  const std::string form = reader.Choice("form", kForms);
  order.form = static_cast<RenderOrder::Form>(std::ranges::find(kForms, form) - kForms.begin());
  const auto side = [&](const char* key) {
    return static_cast<int>(reader.Integer(key, kSmallestRenderSide, kLargestRenderSide));
  };
  order.width = side("width");
  order.height = side("height");
  order.overlay = reader.Boolean("overlay");
  if (json.is_object() && json.contains("at_s") && json["at_s"].is_null()) {
    reader.Ignore("at_s");
  } else {
    order.at_s = reader.Number("at_s", {0, 1e6});
  }
  order.frames_per_second = reader.Number("frames_per_second", {1, 240});
  order.speed = reader.Number("speed", {0.01, 100});
  order.columns = static_cast<int>(reader.Integer("columns", 1, kMostStripColumns));
  order.threads = static_cast<int>(reader.Integer("threads", 1, kMostRenderThreads));
  order.deadline_s = reader.Number("deadline_s", {1, kLongestRender});
  const Json& array = reader.Array("episodes");
  const size_t most = order.form == RenderOrder::Form::kStrip ? kMostStripRows : 1;
  if (array.empty() || array.size() > most) {
    reader.Fail("episodes", absl::StrCat("must have 1 to ", most, " entries for a ", form));
  }
  const Json& track = reader.Object("track");
  RETURN_IF_ERROR(reader.Finish());
  ASSIGN_OR_RETURN(order.track, ParseTrackConfig(track, absl::StrCat(where, ": track")));
  ASSIGN_OR_RETURN(order.episodes, ReadRenderEpisodes(array, where));
  return order;
}

int64_t FilmFrames(const RenderOrder& order, int64_t steps, double period_s) {
  const double length = static_cast<double>(steps) * period_s / order.speed + kFilmHoldSeconds;
  return static_cast<int64_t>(std::ceil(length * order.frames_per_second)) + 1;
}

int64_t StepOfFrame(const RenderOrder& order, int64_t frame, int64_t steps, double period_s) {
  const double time = static_cast<double>(frame) * order.speed / order.frames_per_second;
  return std::clamp<int64_t>(std::llround(time / period_s), 1, steps);
}

int64_t StepOfMoment(const RenderOrder& order, int64_t steps, double period_s) {
  if (!order.at_s.has_value()) return steps;
  return std::clamp<int64_t>(std::llround(*order.at_s / period_s), 1, steps);
}

int64_t StepOfColumn(const RenderOrder& order, int column, int64_t steps) {
  if (order.columns == 1) return steps;
  return std::max<int64_t>(1, std::llround(static_cast<double>(steps) * column /
                                           (order.columns - 1)));
}

}  // namespace myograde
