// myograde show, cancel, choose, hide, unhide, disqualify, baseline
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <iostream>
#include <memory>

#include "server/cli/base/options.h"
#include "server/cli/base/report.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

struct ShowOptions : SubmissionOptions {
  bool episodes = false;
  bool full_hashes = false;
};

void PrintShown(const Json& result, const ShowOptions& options) {
  std::cout << Bold(absl::StrCat("Submission ", options.id, " of ", Cell(result, "team"), ": ",
                                 Cell(result, "state")))
            << '\n'
            << "  " << Cell(result, "track") << " in the profile " << Cell(result, "profile")
            << (result.value("phase", Json()).is_string() ? ", phase " + Cell(result, "phase") : "")
            << (result.value("ranked", false) ? "" : " (practice)") << ", "
            << CountsText(result.value("episodes", Json::object())) << '\n';
  if (result.contains("reason") && result["reason"].is_string()) {
    std::cout << "  " << Cell(result, "reason") << '\n';
  }
  PrintResult(result, options.full_hashes);
  if (options.episodes) {
    PrintEpisodes(result.value("episode_rows", Json::array()),
                  result.value("metrics", Json::array()), options.full_hashes);
  }
}

struct CancelOptions : SubmissionOptions {
  std::string reason;
};

// What the kill did, in words.
std::string KillText(const Json& kill) {
  const int64_t killed = kill.value("killed", int64_t{0});
  if (killed == 0) return "nothing of it was running";
  const std::string took = absl::StrFormat("%.2f s", kill.value("took_wall_s", 0.0));
  std::string text =
      killed == 1
          ? absl::StrCat("its running block of episodes was killed within ", took)
          : absl::StrCat("its ", killed, " running blocks of episodes were killed within ", took);
  if (const int64_t left = kill.value("still_ending", int64_t{0}); left > 0) {
    absl::StrAppend(&text, " (", left, " not dead yet; the slot stays taken until then)");
  }
  return text;
}

// What became of the team's quota, in words; "" if the daemon does not tell.
std::string QuotaText(const Json& status) {
  const Json cancel = status.value("cancel", Json::object());
  if (!cancel.contains("charged")) return "";
  if (!cancel["charged"].is_string()) {
    return " Nothing of the team's quota is used up: no episode of it had ended.";
  }
  return absl::StrCat(" It stays charged to the team's quota, as one ",
                      Cell(cancel, "charged") == "practice" ? "practice" : "official",
                      " evaluation: cancelling gives nothing back.");
}

void PrintCancelled(const Json& status) {
  std::cout << "Submission " << Cell(status, "submission") << " is " << Cell(status, "state")
            << "; " << KillText(status.value("cancel", Json::object())) << "; it keeps "
            << CountsText(status.value("episodes", Json::object())) << "." << QuotaText(status)
            << std::endl;
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

absl::StatusOr<int> Mark(const MarkOptions& options) {
  const bool set = options.set && !options.undo;
  if (set && options.mark == "disqualified" && options.reason.empty()) {
    return absl::InvalidArgumentError(
        "a disqualification needs --reason, which the board shows; --undo takes it back");
  }
  Json body = {{"mark", options.mark}, {"set", set}};
  if (!options.reason.empty()) body["reason"] = options.reason;
  return options.PostAndPrint(options.Resource("/marks"), body,
                              [&](const Json& answer) { PrintMark(answer, options, set); });
}

constexpr char kForTheRecord[] = "Why, for the record; up to 200 bytes";

// `undo_help`: null without a flag --undo.
Action AddMark(CLI::App& verb, const std::string& mark, bool set, const char* undo_help = nullptr,
               const char* reason_help = kForTheRecord) {
  auto options = std::make_shared<MarkOptions>();
  options->mark = mark;
  options->set = set;
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, reason_help);
  AddDaemonOptions(verb, "mark", *options);
  if (undo_help != nullptr) verb.add_flag("--undo", options->undo, undo_help);
  return [options] { return Mark(*options); };
}

}  // namespace

Action AddShow(CLI::App& verb) {
  auto options = std::make_shared<ShowOptions>();
  AddSubmissionId(verb, *options);
  verb.add_flag("--episodes", options->episodes, "Every episode on a line of its own");
  AddFullHashes(verb, options->full_hashes);
  AddDaemonOptions(verb, "show", *options);
  return [options] {
    return options->GetAndPrint(
        options->Resource(options->episodes ? "/result?episodes=1" : "/result"),
        [&](const Json& result) { PrintShown(result, *options); });
  };
}

Action AddCancel(CLI::App& verb) {
  auto options = std::make_shared<CancelOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, kForTheRecord);
  AddDaemonOptions(verb, "cancel", *options);
  return [options] {
    Json body = Json::object();
    if (!options->reason.empty()) body["reason"] = options->reason;
    return options->PostAndPrint(options->Resource("/cancel"), body, PrintCancelled);
  };
}

Action AddChoose(CLI::App& verb) {
  auto options = std::make_shared<SubmissionOptions>();
  AddSubmissionId(verb, *options, /*required=*/true,
                  "A ranked submission of your team that is done");
  AddDaemonOptions(verb, "choose", *options);
  return [options] {
    return options->PostAndPrint(options->Resource("/choose"), Json::object(), PrintChoice);
  };
}

Action AddHide(CLI::App& verb) { return AddMark(verb, "hidden", true); }

Action AddUnhide(CLI::App& verb) { return AddMark(verb, "hidden", false); }

Action AddDisqualify(CLI::App& verb) {
  return AddMark(verb, "disqualified", true, "Bring the submission back",
                 "Why; the board shows it; up to 200 bytes (required, but not with --undo)");
}

Action AddBaseline(CLI::App& verb) {
  return AddMark(verb, "baseline", true, "Make it an ordinary submission again");
}

}  // namespace myograde::server
