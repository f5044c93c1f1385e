// myograde rerun
#include <absl/strings/str_cat.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <set>
#include <string>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

bool Holds(const Json& differs, std::initializer_list<const char*> names) {
  return std::any_of(names.begin(), names.end(), [&](const char* name) {
    return std::find(differs.begin(), differs.end(), Json(name)) != differs.end();
  });
}

// Which difference came first, and so the cause, only the logs tell.
void Judge(const Client& client, const Json& first, const Json& second, Json& entry) {
  const absl::StatusOr<EpisodeLog> a = LogOf(client, first);
  const absl::StatusOr<EpisodeLog> b = LogOf(client, second);
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
                    : states ? "actions and states are the same, so the rules that judge them "
                               "have changed"
                             : "the logs are equal as far as they go";
}

std::string Worst(const std::set<std::string>& verdicts) {
  for (const char* verdict : {"simulator", "policy", "scoring", "unknown"}) {
    if (verdicts.contains(verdict)) return verdict;
  }
  return "same";
}

// For each episode of a re-run whether actions, states and result were the same, and if not, whose
// doing it is: the object `verify` of the verb's JSON. `rerun`: the evaluation with its comparison.
// Where the rows differ, the logs of both playings are asked for.
absl::StatusOr<Json> VerifyRerun(const Client& client, const Json& rerun) {
  ASSIGN_OR_RETURN(Json second,
                   EvaluationWithRows(client, absl::StrCat("/v1/evaluations/",
                                                           rerun.value("evaluation", int64_t{0}))));
  const Json& comparison = second["comparison"];
  ASSIGN_OR_RETURN(Json first,
                   EvaluationWithRows(client, absl::StrCat("/v1/evaluations/",
                                                           comparison.value("with", int64_t{0}))));
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
  const std::string verdict = Worst(verdicts);
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
                    : verdict == "scoring"   ? "The rules of scoring have changed."
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
      absl::StrCat("--episodes: \"", Harmless(text),
                   "\" is no range; write A..B with 0 <= A <= B, both included, as 10..19"));
}

absl::StatusOr<int> ReportRerun(const RerunOptions& options, const Client& client, Json result) {
  const std::string state = result.value("state", "");
  const Json comparison = result.value("comparison", Json());
  if (options.verify && comparison.is_object()) {
    ASSIGN_OR_RETURN(result["verify"], VerifyRerun(client, result));
  }
  if (options.json) {
    PrintJson(result);
  } else {
    std::cout << Bold(absl::StrCat("Re-run ", Cell(result, "evaluation"), " of submission ",
                                   options.id, " is ", Harmless(state)))
              << '\n';
    PrintComparison(comparison);
    if (result.contains("verify")) PrintVerify(result["verify"]);
  }
  if (state == "grader_error") return kTrouble;
  if (state == "cancelled" || !comparison.is_object()) return kNoScore;
  const bool same = comparison.value("equal", int64_t{0}) ==
                        comparison.value("compared", int64_t{-1}) &&
                    comparison.value("missing", int64_t{0}) == 0;
  return same ? kDone : kNoScore;
}

absl::StatusOr<int> Rerun(const RerunOptions& options) {
  if (options.verify && !options.wait) {
    return absl::InvalidArgumentError("--verify: needs the end; leave --no-wait out");
  }
  ASSIGN_OR_RETURN(const Json range, RangeOf(options.episodes));
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json rerun, client.PostOnce(options.Resource("/rerun"), range));
  const int64_t evaluation = rerun.value("evaluation", int64_t{0});
  if (!options.wait) {
    return PrintAnswer(rerun, options.json, [&](const Json& started) {
      std::cout << "Evaluation " << evaluation << " plays episodes " << Cell(started, "first")
                << " to " << Cell(started, "last") << " of submission " << options.id << " again."
                << std::endl;
    });
  }
  ASSIGN_OR_RETURN(const Json result,
                   Follow(client, absl::StrCat("/v1/evaluations/", evaluation),
                          absl::StrCat("re-run of episodes ", Cell(rerun, "first"), " to ",
                                       Cell(rerun, "last"))));
  return ReportRerun(options, client, result);
}

}  // namespace

Action AddRerun(CLI::App& verb) {
  auto options = std::make_shared<RerunOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--episodes", options->episodes,
                  "A..B, counted from 0, both included; the whole blocks of episodes that hold "
                  "them are played (default: all)");
  verb.add_flag("--wait,!--no-wait", options->wait,
                "Wait for the end and print the differences (default), or only start it");
  verb.add_flag("--verify", options->verify,
                "Report for each episode whether actions, states and result were the same, and "
                "where not, whether the policy or the simulator is the cause");
  AddDaemonOptions(verb, "rerun", *options);
  return [options] { return Rerun(*options); };
}

}  // namespace myograde::server
