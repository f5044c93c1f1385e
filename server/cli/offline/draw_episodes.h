// Pictures and films of recorded episodes, by myograde-render and ffmpeg.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/lease/render_order.h"

namespace myograde::server {

enum class FilmFormat { kMp4, kWebm };

// `folder`: empty or not, for temporary files. DataLossError: a log can't be shown. CancelledError
// after SIGINT, SIGTERM or SIGHUP. DeadlineExceededError: it took longer than order.deadline_s.
// InternalError: this host can't draw or encode; the sentence says what is missing.

// The PNG of an order for a picture or a strip.
absl::StatusOr<std::string> DrawPng(const RenderOrder& order, const std::string& folder);

// Writes the film of an order to the file `path`. `progress` hears how many pictures were encoded.
// REQUIRES: even width and height.
absl::Status EncodeFilm(const RenderOrder& order, FilmFormat format, const std::string& folder,
                        const std::string& path, const std::function<void(int64_t)>& progress);

}  // namespace myograde::server
