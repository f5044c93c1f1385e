#include "server/cli/client/verify_rerun.h"

#include <algorithm>
#include <iostream>
#include <set>
#include <string>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/terminal/text.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

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

}  // namespace

absl::StatusOr<Json> VerifyRerun(const Client& client, const Json& rerun) {
  ASSIGN_OR_RETURN(Json second, EvaluationWithRows(
      client, absl::StrCat("/v1/evaluations/", rerun.value("evaluation", int64_t{0}))));
  const Json& comparison = second["comparison"];
  ASSIGN_OR_RETURN(Json first, EvaluationWithRows(
      client, absl::StrCat("/v1/evaluations/", comparison.value("with", int64_t{0}))));
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
      const absl::StatusOr<Json> a = RowOf(first, index);
      const absl::StatusOr<Json> b = RowOf(second, index);
      if (!a.ok() || !b.ok()) return a.ok() ? b.status() : a.status();
      Judge(client, *a, *b, entry);
    }
    verdicts.insert(entry["verdict"].get<std::string>());
    episodes.push_back(std::move(entry));
  }
  if (comparison.value("missing", int64_t{0}) != 0) verdicts.insert("unknown");
  const std::string verdict = Worst(verdicts);
  return Json{{"same", verdict == "same"}, {"verdict", verdict}, {"episodes", episodes}};
}

void PrintVerify(const Json& verify) {
  for (const Json& entry : verify["episodes"]) {
    if (entry["verdict"] == "same") continue;
    const auto word = [&](const char* key) { return entry[key] ? "same" : "differ"; };
    std::cout << "episode " << entry["index"] << ": actions " << word("actions") << ", states "
              << word("states") << ", result " << word("result") << ": "
              << Cell(entry, "detail") << '\n';
  }
  const std::string verdict = verify["verdict"];
  std::cout << Bold(verdict == "same"        ? "Actions, states and results are the same."
                    : verdict == "policy"    ? "The policy is not repeatable."
                    : verdict == "simulator" ? "The simulator has changed."
                    : verdict == "scoring"   ? "The rules of scoring have changed."
                                             : "The cause of the difference is unknown.")
            << std::endl;
}

}  // namespace myograde::server
