// myograde phase: pause, resume, publish; myograde choose
#include <iostream>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

#include "server/base/http_client.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct PhaseOptions : DaemonOptions {
  std::string name;
  std::string reason;
  bool all = false;
};

void PrintAct(const Json& answer) {
  const bool all = answer.value("phase", Json()).is_null();
  const std::string event = Cell(answer, "event");
  const bool changed = answer.value("changed", false);
  std::string now;
  if (event == "resumed") {
    now = changed ? "no longer paused" : "not paused";
  } else {
    now = absl::StrCat(changed ? "now " : "already ", event);
  }
  std::cout << (all ? "Submissions are " : absl::StrCat("Phase ", Cell(answer, "phase"), " is "))
            << now << (changed ? "." : "; nothing changed.");
  if (event == "resumed" && Cell(answer, "state") == "paused") {
    std::cout << " It stays paused, as all submissions are.";
  }
  std::cout << std::endl;
}

int ActOnPhase(const PhaseOptions& options, const std::string& verb) {
  if (options.all == !options.name.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "name one phase, or give --all for all submissions"));
  }
  const std::string path = options.all ? absl::StrCat("/v1/", verb)
                                       : absl::StrCat("/v1/phases/", QueryValue(options.name), "/",
                                                      verb);
  return PrintAnswer(options.client().Post(path, {{"reason", options.reason}}), options.json,
                     PrintAct);
}

void PrintChoice(const Json& answer) {
  std::cout << "Team " << Cell(answer, "team")
            << (answer.value("changed", false) ? " now stands with submission "
                                               : " stood with it already: submission ")
            << Cell(answer, "submission");
  if (answer.value("phase", Json()).is_string()) {
    std::cout << " in phase " << Cell(answer, "phase");
  }
  std::cout << "." << std::endl;
}

}  // namespace

Action AddPhase(CLI::App& verb) {
  auto options = std::make_shared<PhaseOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  const auto add = [&](const std::string& name, const char* does, const char* example) {
    CLI::App* part = verb.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde phase ", example));
    part->add_option("NAME", options->name, "The phase, as \"myograde challenge status\" lists it");
    part->add_option("--reason", options->reason,
                     "Why, for those who submit and for the record; up to 200 bytes")
        ->required();
    part->callback([=] { *chosen = [=] { return ActOnPhase(*options, name); }; });
    AddDaemonOptions(*part, "phase", *options);
    return part;
  };
  const char* all_help = "All submissions, of every track and phase";
  add("pause", "Refuse submissions for now; those that were accepted are played",
      "pause final --reason \"a slot is broken\"")
      ->add_flag("--all", options->all, all_help);
  add("resume", "Accept submissions again", "resume final --reason \"it is repaired\"")
      ->add_flag("--all", options->all, all_help);
  add("publish", "Show everybody a frozen board, and what the phase withheld; can't be undone",
      "publish final --reason \"closing ceremony\"");
  return [chosen] { return (*chosen)(); };
}

Action AddChoose(CLI::App& verb) {
  auto options = std::make_shared<SubmissionOptions>();
  AddSubmissionId(verb, *options, /*required=*/true,
                  "A ranked submission of your team that is done");
  AddDaemonOptions(verb, "choose", *options);
  return [options] {
    return PrintAnswer(options->client().Post(options->Resource("/choose"), Json::object()),
                       options->json, PrintChoice);
  };
}

}  // namespace myograde::server
