// What is written into pictures of an episode.
#pragma once

#include <cstdint>

#include "protocol/lease/render_order.h"
#include "protocol/log/episode_log.h"
#include "sim/environment.h"
#include "sim/render/picture_text.h"
#include "sim/tracks.h"

namespace myograde::sim {

// Of the state after `step` control steps: track, episode, time, measurements, and from the end on
// how it ended.
PictureText FilmText(const SimulatedTrack& track, const RenderOrder& order, const EpisodeLog& log,
                     const Environment& environment, int64_t step);

// The same for a picture of a strip, in fewer words: the title is in the first column only.
PictureText StripText(const RenderEpisode& episode, const EpisodeLog& log, int column,
                      int64_t step);

}  // namespace myograde::sim
