// Figures and reports, drawn by the Python program in server/figures.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

struct Drawn {
  nlohmann::json numbers;  // behind the figure
  std::string file;        // its bytes; "" if the order has no format
};

// Has `order` drawn (server/figures/__main__.py says what it holds). FailedPreconditionError if
// there is nothing to draw, CancelledError after a stop signal, else InternalError: the host lacks
// something, or drawing failed or took too long. Whatever went wrong is said in one sentence.
absl::StatusOr<Drawn> DrawFigure(const nlohmann::json& order);

// The format that a file's name asks for: "svg" of FIGURE.svg. InvalidArgumentError if it ends in
// none of `formats`.
absl::StatusOr<std::string> FormatOf(const std::string& file,
                                     const std::vector<std::string>& formats);

// Puts what was drawn into `file`, or nothing if that is "", and prints what it is: as JSON with
// the numbers, or a line. Returns the exit status.
int ReportDrawn(const Drawn& drawn, const std::string& file, nlohmann::json head, bool json);

// Reports an error of DrawFigure, or of gathering what is to be drawn; returns the exit status.
int ReportNotDrawn(const absl::Status& status);

}  // namespace myograde::server
