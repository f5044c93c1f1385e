// myograde hide, unhide, disqualify, baseline
#include <iostream>
#include <memory>

#include "server/cli/base/exit_status.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct MarkOptions : SubmissionOptions {
  std::string mark;
  bool set = true;
  bool undo = false;
  std::string reason;
};

void PrintMark(const Json& answer, const MarkOptions& options, bool set) {
  const bool changed = answer.value("changed", false);
  const std::string shown = options.mark == "baseline" ? "a baseline" : options.mark;
  std::cout << "Submission " << options.id << " of " << Cell(answer, "team") << " is "
            << (set ? (changed ? "now " : "already ") : (changed ? "no longer " : "not ")) << shown
            << (changed ? "." : "; nothing changed.") << std::endl;
}

int Mark(const MarkOptions& options) {
  const bool set = options.set && !options.undo;
  if (set && options.mark == "disqualified" && options.reason.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "a disqualification needs --reason, which the board shows; --undo takes it back"));
  }
  Json body = {{"mark", options.mark}, {"set", set}};
  if (!options.reason.empty()) body["reason"] = options.reason;
  return PrintAnswer(options.client().Post(options.Resource("/marks"), body), options.json,
                     [&](const Json& answer) { PrintMark(answer, options, set); });
}

constexpr char kForTheRecord[] = "Why, for the record; up to 200 bytes";

std::shared_ptr<MarkOptions> AddMark(CLI::App& verb, const std::string& mark, bool set,
                                     const char* reason_help = kForTheRecord) {
  auto options = std::make_shared<MarkOptions>();
  options->mark = mark;
  options->set = set;
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, reason_help);
  AddDaemonOptions(verb, "mark", *options);
  return options;
}

}  // namespace

Action AddHide(CLI::App& verb) {
  const auto options = AddMark(verb, "hidden", true);
  return [options] { return Mark(*options); };
}

Action AddUnhide(CLI::App& verb) {
  const auto options = AddMark(verb, "hidden", false);
  return [options] { return Mark(*options); };
}

Action AddDisqualify(CLI::App& verb) {
  const auto options = AddMark(verb, "disqualified", true,
                               "Why; the board shows it; up to 200 bytes (required, but not with "
                               "--undo)");
  verb.add_flag("--undo", options->undo, "Bring the submission back");
  return [options] { return Mark(*options); };
}

Action AddBaseline(CLI::App& verb) {
  const auto options = AddMark(verb, "baseline", true);
  verb.add_flag("--undo", options->undo, "Make it an ordinary submission again");
  return [options] { return Mark(*options); };
}

}  // namespace myograde::server
