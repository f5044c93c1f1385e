// Figures and reports, drawn by the Python program in server/figures.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "server/cli/terminal/text.h"

namespace myograde::server {

struct Drawn {
  Json numbers;            // behind the figure
  std::string file;        // its bytes; "" if the order has no format
};

// Has `order` drawn (server/figures/__main__.py says what it holds). FailedPreconditionError if
// there is nothing to draw, CancelledError after a stop signal, else InternalError: the host lacks
// something, or drawing failed or took too long. Whatever went wrong is said in one sentence.
absl::StatusOr<Drawn> DrawFigure(const Json& order);

// Runs "myograde render" with these words. CancelledError after a stop signal; else its sentence if
// it failed.
absl::Status RunRender(std::vector<std::string> words);

// The format that a file's name asks for: "svg" of FIGURE.svg. InvalidArgumentError if it ends in
// none of `formats`.
absl::StatusOr<std::string> FormatOf(const std::string& file,
                                     const std::vector<std::string>& formats);

// How a verb ends that draws: `order`, unless gathering what it holds failed, is drawn into `file`,
// or into nothing if that is "", and what was made is printed: as JSON, `head` with the numbers, or
// a line. After a stop signal kNoScore.
absl::StatusOr<int> DrawInto(const std::string& file, const absl::Status& gathered,
                             const Json& order, Json head, bool json);

}  // namespace myograde::server
