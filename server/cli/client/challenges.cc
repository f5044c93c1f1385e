// myograde challenge status; myograde phase: pause, resume, publish; myograde evaluate: further
// episodes for places that are close
#include "server/cli/client/challenges.h"

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include <iostream>
#include <memory>
#include <string>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr double kDayS = 86400;

// "3 days 4 h" from one time of an answer to another.
std::string Span(const std::string& from, const std::string& to) {
  absl::Time begin;
  absl::Time end;
  std::string unused;
  if (!absl::ParseTime(absl::RFC3339_full, from, &begin, &unused) ||
      !absl::ParseTime(absl::RFC3339_full, to, &end, &unused)) {
    return "-";
  }
  const double seconds = absl::ToDoubleSeconds(end - begin);
  if (seconds < 2 * kDayS) return DurationText(seconds);
  const auto hours = static_cast<int64_t>(seconds / 3600);
  return absl::StrCat(hours / 24, " days ", hours % 24, " h");
}

// What happens next to a phase, and when.
std::string NextOf(const Json& phase, const std::string& now) {
  const std::string state = phase.value("state", "");
  if (state == "closed") return absl::StrCat("closed at ", Cell(phase, "closes_at"));
  const char* key = state == "upcoming" ? "opens_at" : "closes_at";
  if (!phase[key].is_string()) return "stays open";
  const std::string when = phase[key].get<std::string>();
  return absl::StrCat(state == "upcoming" ? "opens" : "closes", " in ", Span(now, when), ", at ",
                      Harmless(when));
}

std::string SeedsOf(const Json& phase) {
  const Json seeds = phase.value("seeds", Json::object());
  return absl::StrCat(Cell(seeds, "count"), " ", Cell(seeds, "kind"),
                      phase.value("revealed", false) ? ", revealed" : "");
}

std::string BoardOf(const Json& phase) {
  if (phase.value("frozen", false)) return absl::StrCat("frozen at ", Cell(phase, "freeze_at"));
  if (phase.value("published", false)) return "published";
  return phase["freeze_at"].is_null() ? "open"
                                      : absl::StrCat("open, freezes at ", Cell(phase, "freeze_at"));
}

void PrintPauses(const Json& challenge) {
  for (const Json& phase : challenge.value("phases", Json::array())) {
    const Json pause = phase.value("paused", Json());
    if (!pause.is_object() || pause.value("all", false)) continue;
    std::cout << "  " << Cell(phase, "phase") << " is paused since " << Cell(pause, "at") << ": "
              << Cell(pause, "reason") << '\n';
  }
}

void PrintCommitments(const Json& challenge) {
  for (const Json& phase : challenge.value("phases", Json::array())) {
    const Json seeds = phase.value("seeds", Json::object());
    if (!seeds.contains("commitment")) continue;
    std::cout << "  Commitment to the seeds of " << Cell(phase, "phase") << ": "
              << Cell(seeds, "commitment") << '\n';
  }
}

void PrintChallenge(const Json& challenge, const std::string& now) {
  std::cout << Bold(absl::StrCat(Cell(challenge, "title"), " (", Cell(challenge, "challenge"), ")"))
            << '\n';
  PrintRows(challenge.value("phases", Json::array()),
            {"phase", "track", "profile", "state",
             RowColumn("next", [&](const Json& phase) { return NextOf(phase, now); }),
             RowColumn("seeds", SeedsOf), "entry", RowColumn("board", BoardOf), "waiting"});
  PrintPauses(challenge);
  PrintCommitments(challenge);
}

void PrintChallenges(const Json& answer) {
  const Json challenges = answer.value("challenges", Json::array());
  if (challenges.empty()) {
    std::cout << "No challenge is held here: every track is open, on its own seeds.\n";
  }
  for (const Json& challenge : challenges) PrintChallenge(challenge, answer.value("now", ""));
  if (const Json pause = answer.value("paused", Json()); pause.is_object()) {
    std::cout << "All submissions are paused since " << Cell(pause, "at") << ": "
              << Cell(pause, "reason") << '\n';
  }
  for (const Json& phase : answer.value("former_phases", Json::array())) {
    std::cout << "Former phase " << Cell(phase, "phase") << " of " << Cell(phase, "track") << ": "
              << CountCell(phase, "submissions", "submission") << "; its board stays, with "
              << "\"myograde leaderboard --phase " << Cell(phase, "phase") << "\"\n";
  }
  for (const Json& phase : answer.value("unusable", Json::array())) {
    std::cout << "Phase " << Cell(phase, "phase") << " takes nothing: " << Cell(phase, "message")
              << '\n';
  }
  std::cout.flush();
}

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

// `act`: "pause", "resume" or "publish".
absl::StatusOr<int> ActOnPhase(const PhaseOptions& options, const std::string& act) {
  if (options.all == !options.name.empty()) {
    return absl::InvalidArgumentError("name one phase, or give --all for all submissions");
  }
  const std::string of = options.all ? "" : absl::StrCat("phases/", QueryValue(options.name), "/");
  return options.PostAndPrint(absl::StrCat("/v1/", of, act), {{"reason", options.reason}},
                              PrintAct);
}

struct EvaluateOptions : DaemonOptions {
  std::string phase;
  std::string board = "main";
  int64_t more_seeds = 0;
  std::string places;  // "A..B", or "" for all that are undecided
  std::string reason = "close places";
  bool wait = false;
};

absl::StatusOr<Json> PlacesOf(const std::string& text) {
  const auto range = ParseRange(text);
  if (range.has_value() && range->first >= 1 && range->second > range->first) {
    return Json{range->first, range->second};
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--places: \"", Harmless(text), "\" is not two ranks as in 2..4"));
}

void PrintFurther(const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const Json submissions = rejudge.value("submissions", Json::array());
    std::cout << "Rejudge " << Cell(rejudge, "rejudge") << " plays "
              << CountCell(rejudge, "episodes", "further episode") << " of "
              << Counted(std::ssize(submissions), "submission") << ":";
    for (const Json& submission : submissions) std::cout << ' ' << submission;
    std::cout << "\n";
    const Json lost = rejudge.value("without_files", Json::array());
    if (!lost.empty()) {
      std::cout << "  The files of " << Counted(std::ssize(lost), "submission")
                << " are not on this host any more, so it gets none.\n";
    }
  }
  std::cout << "No rank by the rules changes. Once they have ended, \"myograde leaderboard --phase "
            << Cell(answer, "phase") << " --statistics\" takes them in." << std::endl;
}

// Until all of them have been played, or were dropped.
absl::Status AwaitFurther(const Client& client, const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const std::string id = Cell(rejudge, "rejudge");
    RETURN_IF_ERROR(FollowUntil(client, "/v1/rejudges/" + id, "rejudge " + id, [](const Json& now) {
                      return now.value("complete", false) || now.value("state", "") == "dropped";
                    }).status());
  }
  return absl::OkStatus();
}

absl::StatusOr<int> Evaluate(const EvaluateOptions& options) {
  Json body = {
      {"episodes", options.more_seeds}, {"board", options.board}, {"reason", options.reason}};
  if (!options.places.empty()) {
    ASSIGN_OR_RETURN(body["places"], PlacesOf(options.places));
  }
  const Client client = options.client();
  ASSIGN_OR_RETURN(
      const Json asked,
      client.Post(absl::StrCat("/v1/phases/", QueryValue(options.phase), "/more-seeds"), body));
  if (options.wait) {
    RETURN_IF_ERROR(AwaitFurther(client, asked));
  }
  return PrintAnswer(asked, options.json, PrintFurther);
}

}  // namespace

Json PhaseIn(const Json& answer, const std::string& name) {
  for (const Json& challenge : answer.value("challenges", Json::array())) {
    for (const Json& phase : challenge.value("phases", Json::array())) {
      if (phase.value("phase", "") == name) return phase;
    }
  }
  return nullptr;
}

absl::StatusOr<Json> FindPhaseOf(const Client& client, const std::string& phase) {
  ASSIGN_OR_RETURN(const Json answer, client.Get("/v1/challenges"));
  Json known = PhaseIn(answer, phase);
  if (known.is_object()) return known;
  return absl::InvalidArgumentError(
      absl::StrCat("there is no phase \"", phase,
                   "\"; \"myograde challenge status\" lists those that there are"));
}

absl::StatusOr<int> ChallengeStatus(const DaemonOptions& options) {
  return options.GetAndPrint("/v1/challenges", PrintChallenges);
}

Action AddPhase(CLI::App& verb) {
  DaemonParts<PhaseOptions> parts(verb);
  const auto add = [&](const std::string& name, const char* does, const char* example, bool all) {
    CLI::App* part = parts.Add(name, does, example, "phase", [name](const PhaseOptions& options) {
      return ActOnPhase(options, name);
    });
    part->add_option("NAME", parts.options().name,
                     "The phase, as \"myograde challenge status\" lists it");
    part->add_option("--reason", parts.options().reason,
                     "Why, for those who submit and for the record; up to 200 bytes")
        ->required();
    if (!all) return;
    part->add_flag("--all", parts.options().all, "All submissions, of every track and phase");
  };
  add("pause", "Refuse submissions for now; those that were accepted are played",
      "pause final --reason \"a slot is broken\"", /*all=*/true);
  add("resume", "Accept submissions again", "resume final --reason \"it is repaired\"",
      /*all=*/true);
  add("publish", "Show everybody a frozen board, and what the phase withheld; can't be undone",
      "publish final --reason \"closing ceremony\"", /*all=*/false);
  return parts.Chosen();
}

Action AddEvaluate(CLI::App& verb) {
  auto options = std::make_shared<EvaluateOptions>();
  verb.add_option("--phase", options->phase, "The phase whose places are close")->required();
  verb.add_option("--more-seeds", options->more_seeds,
                  "Further episodes of each submission in total, on seeds that follow the "
                  "phase's own")
      ->required()
      ->type_name("N");
  verb.add_option("--places", options->places,
                  "First and last rank (default: all that share a group)")
      ->type_name("A..B");
  verb.add_option("--board", options->board, "Name of the board (default: main)");
  verb.add_option("--reason", options->reason,
                  "Why, for the record; up to 200 bytes (default: \"close places\")");
  verb.add_flag("--wait", options->wait, "Wait until they have been played");
  AddDaemonOptions(verb, "evaluate", *options);
  return [options] { return Evaluate(*options); };
}

}  // namespace myograde::server
