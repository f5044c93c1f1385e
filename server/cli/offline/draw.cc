#include "server/cli/offline/draw.h"

#include <unistd.h>

#include <iostream>
#include <vector>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/time/time.h>

#include "server/base/child_process.h"
#include "server/base/counted.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kPython[] = "/usr/bin/python3";
constexpr absl::Duration kDrawingTime = absl::Minutes(10);
constexpr size_t kMostDrawn = size_t{512} << 20;
constexpr mode_t kFigureMode = 0644;
constexpr int kDrawingNice = 10;

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

int ReportDrawn(const Drawn& drawn, const std::string& file, Json head, bool json) {
  head["file"] = nullptr;
  head["bytes"] = nullptr;
  head["sha256"] = nullptr;
  if (!file.empty()) {
    NewFile out(file, kFigureMode);
    if (!out.opened() || !out.Write(drawn.file)) return ReportError(CantWrite(file));
    const absl::StatusOr<std::string> digest = out.Keep();
    if (!digest.ok()) return ReportError(digest.status());
    head["file"] = file;
    head["bytes"] = drawn.file.size();
    head["sha256"] = *digest;
  }
  if (json) {
    head["numbers"] = drawn.numbers;
    PrintJson(head);
  } else {
    std::cout << Harmless(file) << ": " << Counted(std::ssize(drawn.file), "byte") << std::endl;
  }
  return kDone;
}

int ReportNotDrawn(const absl::Status& status) {
  if (!absl::IsCancelled(status)) return ReportError(status);
  PrintToErrors("myograde: interrupted; nothing was written");
  return kNoScore;
}

}  // namespace myograde::server
