// The verbs about one submission: myograde show, cancel, choose, rerun, and submission hide,
// unhide, disqualify, reinstate, baseline
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <set>
#include <string>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/board/acts.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

struct ShowOptions : SubmissionOptions {
  bool episodes = false;
  bool full_hashes = false;
};

void PrintShown(const Json& result, const ShowOptions& options) {
  std::cout << Bold(absl::StrCat("Submission ", options.id, Filled(result, " of {team}: {state}")))
            << Filled(result, "\n  {track} in the profile {profile}[, phase {phase}]")
            << (result.value("ranked", false) ? "" : " (practice)") << ", " << CountsText(result)
            << Filled(result, "\n[  {reason}\n]");
  PrintResult(result, options.full_hashes);
  if (options.episodes) {
    PrintEpisodes(result.value("episode_rows", Json::array()),
                  result.value("metrics", Json::array()), options.full_hashes);
  }
}

// What the kill did, in words.
std::string KillText(const Json& kill) {
  const int64_t killed = kill.value("killed", int64_t{0});
  if (killed == 0) return "none of it was running";
  std::string text = killed == 1
                         ? "its running block of episodes was"
                         : absl::StrCat("its ", killed, " running blocks of episodes were");
  absl::StrAppendFormat(&text, " killed within %.2f s", kill.value("took_wall_s", 0.0));
  if (kill.value("still_ending", int64_t{0}) > 0) {
    text += Filled(kill, " ({still_ending} still ending; the slot stays busy until then)");
  }
  return text;
}

// What became of the team's quota, in words; "" if the daemon does not tell.
std::string QuotaText(const Json& status) {
  const Json cancel = status.value("cancel", Json::object());
  if (!cancel.contains("charged")) return "";
  if (!cancel["charged"].is_string()) {
    return " It does not count against the team's quota: no episode had ended.";
  }
  return absl::StrCat(" It still counts against the team's quota, as one ",
                      cancel["charged"] == "practice" ? "practice" : "official",
                      " evaluation: cancelling refunds nothing.");
}

void PrintCancelled(const Json& status) {
  std::cout << Filled(status, "Submission {submission} is {state}; ")
            << KillText(status.value("cancel", Json::object())) << "; it keeps "
            << CountsText(status) << "." << QuotaText(status) << std::endl;
}

struct MarkOptions : SubmissionOptions {
  std::string reason;
  std::string mark;  // "" of cancel
  bool set = true;
  bool undo = false;
};

absl::StatusOr<int> Mark(const MarkOptions& options) {
  const bool set = options.set && !options.undo;
  RETURN_IF_ERROR(RefuseIf(
      {{set && options.mark == kDisqualified && options.reason.empty(),
        "give --reason: a disqualification needs one, and the board shows it"}}));
  Json body = {{"mark", options.mark}, {"set", set}};
  SetIfGiven(body, "reason", options.reason);
  return options.PostAndPrint(options.Resource("/marks"), body, [&](const Json& answer) {
    const bool changed = answer.value("changed", false);
    std::cout << "Submission " << options.id << Filled(answer, " of {team} is ")
              << (set ? (changed ? "now " : "already ") : (changed ? "no longer " : "not "))
              << (options.mark == kBaseline ? "a baseline" : options.mark)
              << (changed ? "." : "; nothing changed.") << std::endl;
  });
}

Command AddMark(CLI::App& verb, const std::string& mark, bool set,
               const char* reason_help = kReasonHelp) {
  auto options = std::make_shared<MarkOptions>();
  options->mark = mark;
  options->set = set;
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, reason_help);
  AddDaemonOptions(verb, "mark", *options);
  if (mark == kBaseline) {
    verb.add_flag("--undo", options->undo, "Make it an ordinary submission again");
  }
  return [options] { return Mark(*options); };
}

bool Holds(const Json& differs, std::initializer_list<const char*> names) {
  return std::any_of(names.begin(), names.end(), [&](const char* name) {
    return std::find(differs.begin(), differs.end(), Json(name)) != differs.end();
  });
}

// Which difference came first, and so the cause, only the logs tell.
void Judge(const Client& client, const Json& first, const Json& second, Json& entry) {
  const absl::StatusOr<EpisodeLog> a = FetchEpisodeLog(client, first);
  const absl::StatusOr<EpisodeLog> b = FetchEpisodeLog(client, second);
  if (!a.ok() || !b.ok()) {
    entry["verdict"] = "unknown";
    entry["detail"] = std::string((a.ok() ? b.status() : a.status()).message());
    return;
  }
  const LogDifference difference = CompareLogs(*a, *b);
  const bool states = entry["states"] && entry["actions"];
  entry["verdict"] = difference.cause == Cause::kPolicy      ? "policy"
                     : difference.cause == Cause::kSimulator ? "simulator"
                     : states                                ? "scoring"
                                                             : "unknown";
  if (difference.step >= 0) entry["step"] = difference.step;
  entry["detail"] = difference.cause != Cause::kNone ? difference.detail
                    : states ? "actions and states are the same, so the scoring rules have "
                               "changed"
                             : "the logs are equal up to the end of the shorter";
}

// For each episode of a rerun whether actions, states and result were the same, and if not, whose
// doing it is: the object `verify` of the verb's JSON. `rerun`: the evaluation with its comparison.
// Where the rows differ, the logs of both playings are asked for.
absl::StatusOr<Json> VerifyRerun(const Client& client, const Json& rerun) {
  ASSIGN_OR_RETURN(Json second,
                   EvaluationWithRows(client, Filled(rerun, "/v1/evaluations/{evaluation}")));
  const Json& comparison = second["comparison"];
  ASSIGN_OR_RETURN(Json first,
                   EvaluationWithRows(client, Filled(comparison, "/v1/evaluations/{with}")));
  Json episodes = Json::array();
  std::set<std::string> verdicts;
  for (const Json& compared : comparison["episodes"]) {
    const Json& differs = compared["differs"];
    Json entry = {{"index", compared["index"]},
                  {"actions", !Holds(differs, {"actions"})},
                  {"states", !Holds(differs, {"digest", "steps", "sim_time", "seed"})},
                  {"result", !Holds(differs, {"outcome", "reason", "metrics", "facts", "clipped"})},
                  {"verdict", "same"},
                  {"step", nullptr},
                  {"detail", nullptr}};
    if (!compared["equal"]) {
      const int64_t index = compared["index"];
      ASSIGN_OR_RETURN(const Json a, RowOf(first, index));
      ASSIGN_OR_RETURN(const Json b, RowOf(second, index));
      Judge(client, a, b, entry);
    }
    verdicts.insert(entry["verdict"].get<std::string>());
    episodes.push_back(std::move(entry));
  }
  if (comparison.value("missing", int64_t{0}) != 0) verdicts.insert("unknown");
  std::string verdict = "same";
  for (const char* worse : {"unknown", "scoring", "policy", "simulator"}) {
    if (verdicts.contains(worse)) verdict = worse;
  }
  return Json{{"same", verdict == "same"}, {"verdict", verdict}, {"episodes", episodes}};
}

// One line for each episode that is not the same, and the verdict.
void PrintVerify(const Json& verify) {
  for (const Json& entry : verify["episodes"]) {
    if (entry["verdict"] == "same") continue;
    const auto word = [&](const char* key) { return entry[key] ? "same" : "differ"; };
    std::cout << "episode " << entry["index"] << ": actions " << word("actions") << ", states "
              << word("states") << ", result " << word("result") << ": " << Cell(entry, "detail")
              << '\n';
  }
  const std::string verdict = verify["verdict"];
  std::cout << Bold(verdict == "same"        ? "Actions, states and results are the same."
                    : verdict == "policy"    ? "The policy is not repeatable."
                    : verdict == "simulator" ? "The simulator has changed."
                    : verdict == "scoring"   ? "The scoring rules have changed."
                                             : "The cause of the difference is unknown.")
            << std::endl;
}

struct RerunOptions : SubmissionOptions {
  std::string episodes;
  bool wait = true;
  bool verify = false;
};

// "A..B", both counted from 0 and included, or "A" for one.
absl::StatusOr<Json> RangeOf(const std::string& text) {
  if (text.empty()) return Json::object();
  const auto range = ParseRange(text.find("..") == std::string::npos ? text + ".." + text : text);
  if (range.has_value() && range->first >= 0 && range->second >= range->first) {
    return Json{{"first", range->first}, {"last", range->second}};
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--episodes: \"", Sanitized(text),
                   "\" is not a range; write A..B with 0 <= A <= B, both included, as 10..19"));
}

// What a rerun found, episode by episode.
void PrintComparison(const Json& comparison) {
  if (!comparison.is_object()) return;
  for (const Json& episode : comparison.value("episodes", Json::array())) {
    std::cout << Filled(episode, "  episode {index}: ");
    if (episode.value("equal", false)) {
      std::cout << "equal\n";
      continue;
    }
    std::cout << Filled(episode,
                        "differs in {differs} (was {original.outcome} after {original.steps:step}, "
                        "now {rerun.outcome} after {rerun.steps:step})\n");
  }
  if (!comparison.value("equal", Json(0)).is_number()) {
    std::cout << "  the phase withholds the comparison" << std::endl;
    return;
  }
  const auto equal = comparison.value("equal", int64_t{0});
  std::cout << "  " << equal << " of " << CountCell(comparison, "compared", "episode")
            << (equal == 1 ? " is equal" : " are equal");
  if (comparison.value("missing", 0) > 0) {
    std::cout << Filled(comparison, "; {missing} can't be compared");
  }
  std::cout << std::endl;
}

absl::StatusOr<int> ReportRerun(const RerunOptions& options, const Client& client, Json result) {
  const std::string state = result.value("state", "");
  const Json comparison = result.value("comparison", Json());
  if (options.verify && comparison.is_object()) {
    ASSIGN_OR_RETURN(result["verify"], VerifyRerun(client, result));
  }
  const bool same = state != "cancelled" && comparison.is_object() &&
                    comparison.value("equal", int64_t{0}) ==
                        comparison.value("compared", int64_t{-1}) &&
                    comparison.value("missing", int64_t{0}) == 0;
  return PrintAnswer(
      result, options.json,
      [&](const Json&) {
        std::cout << Bold(absl::StrCat(Filled(result, "Rerun {evaluation} of submission "),
                                       options.id, " is ", Sanitized(state)))
                  << '\n';
        PrintComparison(comparison);
        if (result.contains("verify")) PrintVerify(result["verify"]);
      },
      state == "grader_error" ? kTrouble : same ? kDone : kNoScore);
}

absl::StatusOr<int> Rerun(const RerunOptions& options) {
  RETURN_IF_ERROR(RefuseIf(
      {{options.verify && !options.wait,
        "--verify: the rerun must end first; leave --no-wait out"}}));
  ASSIGN_OR_RETURN(const Json range, RangeOf(options.episodes));
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json rerun, client.Post(options.Resource("/rerun"), range, /*once=*/true));
  if (!options.wait) {
    return PrintAnswer(rerun, options.json,
                       Sentence(absl::StrCat(
                           "Evaluation {evaluation} reruns episodes {first} to {last} of "
                           "submission ", options.id, ".")));
  }
  ASSIGN_OR_RETURN(const Json result,
                   FollowUntil(client, Filled(rerun, "/v1/evaluations/{evaluation}"),
                          Filled(rerun, "rerun of episodes {first} to {last}")));
  return ReportRerun(options, client, result);
}

}  // namespace

Command AddShow(CLI::App& verb) {
  auto options = std::make_shared<ShowOptions>();
  AddSubmissionId(verb, *options);
  verb.add_flag("--episodes", options->episodes, "Show each episode on a line");
  AddFullHashes(verb, options->full_hashes);
  AddDaemonOptions(verb, "show", *options);
  return [options] {
    return options->GetAndPrint(
        options->Resource(options->episodes ? "/result?episodes=1" : "/result"),
        [&](const Json& result) { PrintShown(result, *options); });
  };
}

Command AddCancel(CLI::App& verb) {
  auto options = std::make_shared<MarkOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, kReasonHelp);
  AddDaemonOptions(verb, "cancel", *options);
  return [options] {
    Json body = Json::object();
    SetIfGiven(body, "reason", options->reason);
    return options->PostAndPrint(options->Resource("/cancel"), body, PrintCancelled);
  };
}

Command AddChoose(CLI::App& verb) {
  auto options = std::make_shared<SubmissionOptions>();
  AddSubmissionId(verb, *options, /*required=*/true,
                  "A ranked, finished submission of your team");
  AddDaemonOptions(verb, "choose", *options);
  return [options] {
    return options->PostAndPrint(
        options->Resource("/choose"), Json::object(),
        Sentence(
            "Submission {submission} is now the entry of team {team}[ in phase {phase}].",
            "Submission {submission} was already the entry of team {team}[ in phase {phase}]; "
            "nothing changed."));
  };
}

Command AddHide(CLI::App& verb) { return AddMark(verb, kHidden, true); }

Command AddUnhide(CLI::App& verb) { return AddMark(verb, kHidden, false); }

Command AddDisqualify(CLI::App& verb) {
  return AddMark(verb, kDisqualified, true,
                 "Reason, shown on the board; up to 200 bytes (required)");
}

Command AddReinstate(CLI::App& verb) { return AddMark(verb, kDisqualified, false); }

Command AddBaseline(CLI::App& verb) { return AddMark(verb, kBaseline, true); }

Command AddRerun(CLI::App& verb) {
  auto options = std::make_shared<RerunOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--episodes", options->episodes,
                  "A..B, counted from 0, both included; whole blocks of episodes are played "
                  "(default: all)");
  verb.add_flag("--wait,!--no-wait", options->wait,
                "Wait for the end and print the differences (default), or only start the rerun");
  verb.add_flag("--verify", options->verify,
                "Report for each episode whether actions, states and result are the same, and if "
                "not, whether the policy or the simulator is the cause");
  AddDaemonOptions(verb, "rerun", *options);
  return [options] { return Rerun(*options); };
}

}  // namespace myograde::server
