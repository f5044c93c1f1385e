#include "server/cli/offline/draw.h"

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>

#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/counted.h"
#include <iostream>
#include <utility>
#include <vector>
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";
constexpr absl::Duration kDrawingTime = absl::Minutes(10);
constexpr size_t kMostDrawn = size_t{512} << 20;
constexpr mode_t kFigureMode = 0644;
constexpr int kDrawingNice = 10;
constexpr absl::Duration kRenderTime = absl::Hours(24);  // "render" has a deadline of its own
constexpr size_t kMostRenderOutput = size_t{1} << 20;

// The program's folder.
std::string DrawingProgram() { return ShareDir() + "/figures"; }

absl::Status CantDraw(const std::string& why) {
  return absl::InternalError(absl::StrCat("the figure could not be drawn: ", why));
}

absl::Status RunFailure(const absl::Status& status) {
  if (absl::IsCancelled(status)) return status;
  if (absl::IsDeadlineExceeded(status)) {
    return CantDraw(absl::StrCat("it took longer than ", absl::FormatDuration(kDrawingTime)));
  }
  return CantDraw(std::string(status.message()));
}

absl::StatusOr<Drawn> ReadAnswer(const ProgramEnd& run) {
  const size_t end = run.output.find('\n');
  const Json answer = Json::parse(run.output.substr(0, end), nullptr, /*allow_exceptions=*/false);
  if (run.exit_status != 0 || end == std::string::npos || !answer.is_object()) {
    const std::string error = run.LastError();
    return CantDraw(absl::StrCat("the drawing program ", run.HowItEnded(),
                                 error.empty() ? "" : ": ", Harmless(error)));
  }
  if (answer.contains("error")) {
    const std::string sentence = Harmless(answer.value("error", ""));
    if (answer.value("whose", "") == "caller") return absl::FailedPreconditionError(sentence);
    return absl::InternalError(sentence);
  }
  Drawn drawn = {answer.value("numbers", Json()), run.output.substr(end + 1)};
  if (drawn.file.size() != answer.value("bytes", size_t{0})) {
    return CantDraw("the drawing program printed only a part of it");
  }
  return drawn;
}

}  // namespace

absl::StatusOr<Drawn> DrawFigure(const Json& order) {
  // -I: neither the user's packages nor the environment change what is drawn.
  const absl::StatusOr<ProgramEnd> run =
      RunProgram({.program = kPython,
                  .words = {"-I", "-B", DrawingProgram()},
                  .input = order.dump(-1, ' ', false, Json::error_handler_t::replace),
                  .most_output = kMostDrawn,
                  .deadline = kDrawingTime,
                  .nice = kDrawingNice},
                 StopRequested);
  if (!run.ok()) return RunFailure(run.status());
  return ReadAnswer(*run);
}

absl::Status RunRender(std::vector<std::string> words) {
  words.insert(words.begin(), "render");
  const absl::StatusOr<ProgramEnd> run = RunProgram({.program = "myograde",
                                                     .words = std::move(words),
                                                     .most_output = kMostRenderOutput,
                                                     .deadline = kRenderTime,
                                                     .nice = kDrawingNice},
                                                    StopRequested);
  if (absl::IsCancelled(run.status())) return run.status();
  if (run.ok() && run->exit_status == 0) return absl::OkStatus();
  return absl::InternalError(absl::StripPrefix(Harmless(WhyItFailed(run)), "myograde: error: "));
}

absl::StatusOr<std::string> FormatOf(const std::string& file,
                                     const std::vector<std::string>& formats) {
  for (const std::string& format : formats) {
    if (absl::EndsWithIgnoreCase(file, "." + format)) return format;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("-o ", file, ": name a file that ends in ",
                   absl::StrJoin(formats, " or ", [](std::string* out, const std::string& format) {
                     absl::StrAppend(out, ".", format);
                   })));
}

absl::StatusOr<int> DrawInto(const std::string& file, const absl::Status& gathered,
                             const Json& order, Json head, bool json) {
  const absl::StatusOr<Drawn> drawn = gathered.ok() ? DrawFigure(order) : gathered;
  if (absl::IsCancelled(drawn.status())) {
    PrintToErrors("myograde: interrupted; nothing was written");
    return kNoScore;
  }
  if (!drawn.ok()) return drawn.status();
  head["file"] = TextOrNull(file);
  head["bytes"] = nullptr;
  head["sha256"] = nullptr;
  if (!file.empty()) {
    ASSIGN_OR_RETURN(head["sha256"], WriteNewFile(file, drawn->file, kFigureMode));
    head["bytes"] = drawn->file.size();
  }
  head["numbers"] = drawn->numbers;
  return PrintAnswer(head, json, [](const Json& figure) {
    std::cout << Cell(figure, "file") << ": " << CountCell(figure, "bytes", "byte") << std::endl;
  });
}

}  // namespace myograde::server
