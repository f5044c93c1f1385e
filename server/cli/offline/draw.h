// Figures and reports, drawn by the Python program in server/figures from the daemon's answers to the
// caller and nothing else, so nobody sees more in a figure than in the API.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "protocol/lease/render_order.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {

// A submission's result with its episodes, without what no figure shows. Errors of Client::Get.
absl::StatusOr<Json> ResultForFigures(const Client& client, int64_t submission);

// Adds "board", "statistics" and "moments" to `order`. Moments are how the board was whenever
// something changed, each with "at" and "rows", oldest first; the last is now. They come from the
// public record; of more than 200 changes as many are taken, evenly.
absl::Status AddBoard(const Client& client, const BoardChoice& choice, Json& order);

// The same, and "results", one of each row of the board: the evaluation with its episodes, or
// "submission", "team", "name" and in "error" why the caller does not see it; "challenge", its
// title, and "phase", as GET /v1/challenges has it, null if no challenge has the phase of the
// board.
absl::Status AddWholeBoard(const Client& client, const BoardChoice& choice, Json& order);

// Whether this host can draw figures: InternalError says what it lacks. To be asked before gathering what
// takes long.
absl::Status CheckDrawing();

struct Drawn {
  Json numbers;      // behind the figure
  std::string file;  // its bytes; "" if the order has no format
};

// Has `order` drawn (server/figures/__main__.py says what it holds). FailedPreconditionError if
// there is nothing to draw, CancelledError after a stop signal, else InternalError: the host lacks
// something, or drawing failed or took too long. The error is one sentence.
absl::StatusOr<Drawn> DrawFigure(const Json& order);

// Runs "myograde episode render" with these words. CancelledError after a stop signal; else its sentence if
// it failed.
absl::Status RunRender(std::vector<std::string> words);

// Ends a verb that draws: unless `gathered` is an error, draws `order` into `file` ("": none) and
// prints what was made: as JSON, `head` with the numbers, or a line. After a stop signal kNoScore.
absl::StatusOr<int> DrawInto(const std::string& file, const absl::Status& gathered,
                             const Json& order, Json head, bool json);

// Pictures and films of recorded episodes, by myograde-render and ffmpeg.
enum class FilmFormat { kMp4, kWebm };

// `folder`: empty or not, for temporary files. DataLossError: a log can't be shown. CancelledError
// after SIGINT, SIGTERM or SIGHUP. DeadlineExceededError: it took longer than order.deadline_s.
// InternalError: this host can't draw or encode; the sentence says what is missing.

// The PNG of an order for a picture or a strip.
absl::StatusOr<std::string> DrawPng(const RenderOrder& order, const std::string& folder);

// Writes the film of an order to the file `path`. `progress` is called with the pictures encoded so
// far.
// REQUIRES: even width and height.
absl::Status EncodeFilm(const RenderOrder& order, FilmFormat format, const std::string& folder,
                        const std::string& path, const std::function<void(int64_t)>& progress);

}  // namespace myograde::server
