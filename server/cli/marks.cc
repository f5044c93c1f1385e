// myograde hide, unhide, disqualify, baseline
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/terminal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct MarkOptions {
  ApiOptions daemon;
  int64_t id = 0;
  std::string mark;
  bool set = true;
  bool undo = false;
  std::string reason;
  bool json = false;
};

int Mark(const MarkOptions& options) {
  const bool set = options.set && !options.undo;
  if (set && options.mark == "disqualified" && options.reason.empty()) {
    return Complain(absl::InvalidArgumentError(
        "a disqualification needs --reason, which the board shows; --undo brings back"));
  }
  const Client client(options.daemon.path());
  Json body = {{"mark", options.mark}, {"set", set}};
  if (!options.reason.empty()) body["reason"] = options.reason;
  const absl::StatusOr<Json> answer =
      client.Post(absl::StrCat("/v1/submissions/", options.id, "/marks"), body);
  if (!answer.ok()) return Complain(answer.status());
  if (options.json) {
    PrintJson(*answer);
    return kDone;
  }
  const bool changed = answer->value("changed", false);
  const std::string shown = options.mark == "baseline" ? "a baseline" : options.mark;
  std::cout << "Submission " << options.id << " of " << Cell(*answer, "team") << " is "
            << (set ? (changed ? "now " : "already ") : (changed ? "no longer " : "not ")) << shown
            << (changed ? "." : "; nothing changed.") << std::endl;
  return kDone;
}

std::shared_ptr<MarkOptions> AddMark(CLI::App& verb, const std::string& mark, bool set,
                                     const char* why) {
  auto options = std::make_shared<MarkOptions>();
  options->mark = mark;
  options->set = set;
  AddSubmissionId(verb, options->id);
  verb.add_option("--reason", options->reason, why);
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/mark.json)");
  AddDaemonOptions(verb, options->daemon);
  return options;
}

constexpr char kForTheRecord[] = "Why, for the record; up to 200 bytes";

}  // namespace

Action AddHide(CLI::App& verb) {
  const auto options = AddMark(verb, "hidden", true, kForTheRecord);
  return [options] { return Mark(*options); };
}

Action AddUnhide(CLI::App& verb) {
  const auto options = AddMark(verb, "hidden", false, kForTheRecord);
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
  const auto options = AddMark(verb, "baseline", true, kForTheRecord);
  verb.add_flag("--undo", options->undo, "Make it an ordinary submission again");
  return [options] { return Mark(*options); };
}

}  // namespace myograde::server
