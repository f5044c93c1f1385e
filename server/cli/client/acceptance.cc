#include "server/cli/client/acceptance.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/client/challenges.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

// Submissions of a team that are looked through for this policy.
constexpr int kSubmissionsAsked = 1000;

// What could not be asked, which is no fault of the submission.
Finding NotAnswered(const char* check, const absl::Status& status) {
  return {check, FindingState::kUnknown, std::string(status.message()), "try again"};
}

Finding ServerFinding(const Client& client, const Json& whoami) {
  const std::string role = whoami.value("role", "");
  if (role != "public") {
    return {"server", FindingState::kOk,
            absl::StrCat(client.where(), " takes you for ", Cell(whoami, "caller"), ", ", role)};
  }
  return {"server", FindingState::kFails,
          absl::StrCat(client.where(), " does not know you, and only members of teams can submit"),
          "log in with \"myograde login URL\" and the token that the organisers gave you, or have "
          "them add you to a team"};
}

// A team without members is founded by its first submission where there is no challenge.
Finding UnknownTeam(const SubmissionPlan& plan, bool challenge) {
  if (challenge) {
    return {"team", FindingState::kFails,
            absl::StrCat("the server has no team \"", plan.team, "\" that you belong to"),
            "\"myograde whoami\" lists your teams; organisers create teams and add members"};
  }
  return {"team", FindingState::kOk,
          absl::StrCat("the server knows no team \"", plan.team,
                       "\" of yours yet; the first submission founds it, if nobody has the name")};
}

Finding TeamFinding(const Client& client, const SubmissionPlan& plan, bool challenge) {
  const absl::StatusOr<Json> team = client.Get("/v1/teams/" + QueryValue(plan.team));
  if (!team.ok()) {
    if (AnsweredCode(team.status()) == "not_found") return UnknownTeam(plan, challenge);
    return NotAnswered("team", team.status());
  }
  const std::string name = team->value("team", "");
  if (team->value("banned", false)) {
    return {"team", FindingState::kFails,
            absl::StrCat("the organisers have banned team \"", name, "\""), "ask the organisers"};
  }
  const std::string called = name == plan.team ? "" : absl::StrCat(", which is \"", name, "\" now");
  return {"team", FindingState::kOk,
          absl::StrCat("you may submit for team \"", plan.team, "\"", called)};
}

// The sentence of a pause, "" if there is none.
std::string PauseText(const Json& pause, const std::string& what) {
  if (!pause.is_object()) return "";
  return absl::StrCat("the organisers have paused ", what, ": ", Cell(pause, "reason"));
}

Finding Paused(const std::string& text) {
  return {"phase", FindingState::kFails, text, "wait until they resume; \"myograde challenge status\" "
                                               "shows it"};
}

Finding NotOpen(const Json& phase) {
  const bool upcoming = phase.value("state", "") == "upcoming";
  return {"phase", FindingState::kFails,
          absl::StrCat("phase \"", Cell(phase, "phase"),
                       upcoming ? "\" opens at " : "\" closed at ",
                       Cell(phase, upcoming ? "opens_at" : "closes_at")),
          upcoming ? "submit then, or practise with --episodes" : "see \"myograde challenge status\""};
}

Finding PhaseFinding(const SubmissionPlan& plan, const Json& phase) {
  const std::string name = Cell(phase, "phase");
  if (const std::string pause = PauseText(phase.value("paused", Json()),
                                          absl::StrCat("phase \"", name, "\""));
      !pause.empty()) {
    return Paused(pause);
  }
  const Json track = phase.value("track", Json());
  const Json profile = phase.value("profile", Json());
  if (track != plan.track || (!plan.profile.empty() && profile != plan.profile)) {
    return {"phase", FindingState::kFails,
            absl::StrCat("phase \"", name, "\" is of track \"", Cell(phase, "track"),
                         "\" in the profile \"", Cell(phase, "profile"), "\""),
            "leave --track and --profile out"};
  }
  if (phase.value("state", "") != "open") return NotOpen(phase);
  const Json teams = phase.value("teams", Json());
  if (teams.is_array() && std::find(teams.begin(), teams.end(), plan.team) == teams.end()) {
    return {"phase", FindingState::kWarning,
            absl::StrCat("phase \"", name, "\" is for teams that the organisers have named, and \"",
                         plan.team, "\" is not among these names"),
            "ask the organisers, unless one of them is a former name of your team"};
  }
  const Json closes = phase.value("closes_at", Json());
  return {
      "phase", FindingState::kOk,
      absl::StrCat("phase \"", name, "\" of track \"", plan.track, "\" is open",
                   closes.is_string() ? absl::StrCat(" until ", Cell(phase, "closes_at")) : "")};
}

// The phases that a submission could be for.
std::vector<Json> PhasesOf(const Json& challenges, const SubmissionPlan& plan) {
  std::vector<Json> phases;
  for (const Json& challenge : challenges.value("challenges", Json::array())) {
    for (const Json& phase : challenge.value("phases", Json::array())) {
      if (phase.value("track", "") == plan.track) phases.push_back(phase);
    }
  }
  return phases;
}

struct Place {
  std::string phase;  // "": the track itself
  Finding finding;
};

Place PlaceAmong(const SubmissionPlan& plan, const std::vector<Json>& phases) {
  std::vector<Json> open;
  for (const Json& phase : phases) {
    const bool fits = plan.profile.empty() || phase.value("profile", "") == plan.profile;
    if (fits && phase.value("state", "") == "open") open.push_back(phase);
  }
  if (open.size() == 1) return {open[0].value("phase", ""), PhaseFinding(plan, open[0])};
  if (open.empty()) {
    // The one that opens or closed last tells most.
    return {phases.back().value("phase", ""), PhaseFinding(plan, phases.back())};
  }
  std::vector<std::string> names;
  for (const Json& phase : open) names.push_back(Cell(phase, "phase"));
  return {"",
          {"phase", FindingState::kFails,
           absl::StrCat("track \"", plan.track, "\" has ", open.size(),
                        " open phases: ", absl::StrJoin(names, ", ")),
           "name one with --phase"}};
}

Place PlaceOf(const SubmissionPlan& plan, const Json& challenges) {
  const std::string pause = PauseText(challenges.value("paused", Json()), "all submissions");
  if (!pause.empty()) return {plan.phase, Paused(pause)};
  if (plan.practice) {
    return {"",
            {"phase", FindingState::kOk,
             absl::StrCat("practice on track \"", plan.track, "\" is open")}};
  }
  if (!plan.phase.empty()) {
    const Json phase = PhaseIn(challenges, plan.phase);
    if (phase.is_object()) return {plan.phase, PhaseFinding(plan, phase)};
    return {plan.phase,
            {"phase", FindingState::kFails,
             absl::StrCat("the server has no phase \"", plan.phase, "\""),
             "\"myograde challenge status\" lists those that there are"}};
  }
  const std::vector<Json> phases = PhasesOf(challenges, plan);
  if (!phases.empty()) return PlaceAmong(plan, phases);
  return {"",
          {"phase", FindingState::kOk,
           absl::StrCat("track \"", plan.track, "\" is open, without phases")}};
}

// Whether an episode here is one there: by the hash of all rules, budgets and seeds.
Finding RulesFinding(const Client& client, const SubmissionPlan& plan) {
  const absl::StatusOr<Json> tracks = client.Get("/v1/tracks");
  if (!tracks.ok()) return NotAnswered("rules", tracks.status());
  std::vector<std::string> names;
  for (const Json& track : tracks->value("tracks", Json::array())) {
    names.push_back(Cell(track, "track"));
    if (track.value("track", "") != plan.track) continue;
    const std::string wanted =
        plan.profile.empty() ? track.value("default_profile", "") : plan.profile;
    for (const Json& profile : track.value("profiles", Json::array())) {
      if (profile.value("profile", "") != wanted) continue;
      const std::string there = profile.value("config", "");
      if (there == plan.config) {
        return {"rules", FindingState::kOk,
                "the server's rules and budgets are those of this host"};
      }
      return {"rules", FindingState::kWarning,
              absl::StrCat("the server grades under config ", HashText(there, /*full=*/false),
                           ", this host has ", HashText(plan.config, /*full=*/false),
                           ": what is played and checked here may differ"),
              "use the version and the configs of the server here (--configs)"};
    }
    return {"rules", FindingState::kFails,
            absl::StrCat("the server's track \"", plan.track, "\" has no profile \"", wanted, "\""),
            "\"myograde spec\" lists the profiles of this host"};
  }
  return {"rules", FindingState::kFails, absl::StrCat("the server has no track \"", plan.track, "\""),
          absl::StrCat("it has ", absl::StrJoin(names, ", "))};
}

// Whether the server offers the runtimes that policy.json names.
Finding RuntimesFinding(const Client& client, const SubmissionPlan& plan) {
  if (plan.runtimes.empty()) return {"runtimes", FindingState::kOk, "policy.json names none"};
  const absl::StatusOr<std::vector<std::string>> offered = OfferedRuntimes(client);
  if (!offered.ok()) return NotAnswered("runtimes", offered.status());
  const std::string missing = MissingRuntime(plan.runtimes, *offered);
  if (!missing.empty()) {
    return {"runtimes", FindingState::kFails, missing,
            "name one that it has in policy.json, put what you need into the submission, or ask the "
            "organisers"};
  }
  return {"runtimes", FindingState::kOk,
          absl::StrCat("the server has ", absl::StrJoin(plan.runtimes, ", "))};
}

// Why nothing is left of one budget; "" while something is.
std::string UsedUp(const Json& place, const std::string& budget, const std::string& next_day) {
  const Json uses = place.value(budget, Json::object());
  for (const auto& [span, words] : {std::pair("per_day", " today"), std::pair("total", " in all")}) {
    const Json use = uses.value(span, Json());
    if (!use.is_object() || use.value("left", int64_t{1}) > 0) continue;
    const int64_t limit = use.value("limit", int64_t{0}) + use.value("granted", int64_t{0});
    return absl::StrCat("the quota of ", budget == "failed" ? "failed tries" : absl::StrCat(budget, " submissions"),
                        " is used up: ", limit, " of ", limit, words,
                        span == std::string("per_day") ? absl::StrCat("; the next day begins at ", next_day)
                                                       : "");
  }
  return "";
}

std::string LeftText(const Json& place, const std::string& budget) {
  const Json uses = place.value(budget, Json::object());
  return absl::StrCat(Cell(uses.value("per_day", Json::object()), "left"), " ", budget,
                      " submissions are left today, ",
                      Cell(uses.value("total", Json::object()), "left"), " in all");
}

Finding QuotaAt(const Json& quota, const Json& place, const std::string& budget) {
  for (const std::string& one : {budget, std::string("failed")}) {
    const std::string used_up = UsedUp(place, one, Cell(quota, "next_day_at"));
    if (used_up.empty()) continue;
    return {"quota", FindingState::kFails, used_up, "organisers can grant more; \"myograde quota\" shows "
                                                    "what was used"};
  }
  const Json waiting = place.value("waiting", Json::object());
  if (waiting.value("used", int64_t{0}) >= waiting.value("limit", int64_t{1})) {
    return {"quota", FindingState::kFails,
            absl::StrCat(Counted(waiting.value("used", int64_t{0}), "evaluation"),
                         " of the team wait already, which is the limit"),
            "wait until one has ended"};
  }
  return {"quota", FindingState::kOk, LeftText(place, budget)};
}

// nullopt: the server knows no such team, which then has used nothing.
std::optional<Finding> QuotaFinding(const Client& client, const SubmissionPlan& plan,
                                    const std::string& phase) {
  const absl::StatusOr<Json> quota = client.Get(absl::StrCat(
      "/v1/quota?team=", QueryValue(plan.team), "&track=", QueryValue(plan.track), "&limit=1"));
  if (!quota.ok()) {
    const std::string code = AnsweredCode(quota.status());
    if (code == "not_found" || code == "unknown_track") return std::nullopt;
    return NotAnswered("quota", quota.status());
  }
  const char* list = phase.empty() ? "tracks" : "phases";
  const char* key = phase.empty() ? "track" : "phase";
  for (const Json& place : quota->value(list, Json::array())) {
    if (place.value(key, "") != (phase.empty() ? plan.track : phase)) continue;
    return QuotaAt(*quota, place, plan.practice ? "practice" : "official");
  }
  return std::nullopt;
}

// Whether this policy is ranked there already: nothing would be played again.
std::optional<Finding> TwinFinding(const Client& client, const SubmissionPlan& plan,
                                   const std::string& phase) {
  if (plan.practice || plan.artefact.empty()) return std::nullopt;
  std::string path =
      absl::StrCat("/v1/submissions?team=", QueryValue(plan.team), "&track=", QueryValue(plan.track),
                   "&limit=", kSubmissionsAsked);
  if (!phase.empty()) absl::StrAppend(&path, "&phase=", QueryValue(phase));
  const absl::StatusOr<Json> answer = client.Get(path);
  if (!answer.ok()) return std::nullopt;  // the team's finding says why
  for (const Json& submission : answer->value("submissions", Json::array())) {
    const Json config_profile = submission.value("profile", Json());
    if (submission.value("artefact", "") != plan.artefact || !submission.value("ranked", false) ||
        (!plan.profile.empty() && config_profile != plan.profile)) {
      continue;
    }
    return Finding{"novelty", FindingState::kWarning,
                   absl::StrCat("this very policy is submission ", Cell(submission, "submission"),
                                " of the team, which is ", Cell(submission, "state"),
                                "; a ranked policy is played once"),
                   "see \"myograde show ID\"; change the policy, or rerun that submission"};
  }
  return std::nullopt;
}

}  // namespace

absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client) {
  ASSIGN_OR_RETURN(const Json answer, client.Get("/v1/runtimes"));
  std::vector<std::string> names;
  for (const Json& runtime : answer.value("runtimes", Json::array())) {
    names.push_back(runtime.value("runtime", ""));
  }
  return names;
}

std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered) {
  for (const std::string& name : named) {
    if (std::find(offered.begin(), offered.end(), name) != offered.end()) continue;
    return absl::StrCat("policy.json asks for the runtime \"", Harmless(name),
                        "\", which this server does not have; it has ",
                        offered.empty() ? "none" : Harmless(absl::StrJoin(offered, ", ")));
  }
  return "";
}

Acceptance AskAcceptance(const Client& client, const SubmissionPlan& plan) {
  const absl::StatusOr<Json> whoami = client.Get("/v1/whoami");
  if (!whoami.ok()) {
    // A refusal is an answer: the token is bad.
    const bool refused = whoami.status().code() == absl::StatusCode::kInvalidArgument;
    return {refused,
            {{"server", refused ? FindingState::kFails : FindingState::kUnknown,
              std::string(whoami.status().message()),
              refused ? "log in again with \"myograde login URL\""
                      : "team, phase, rules, runtimes and quota are not checked"}}};
  }
  Acceptance acceptance = {true, {ServerFinding(client, *whoami)}};
  std::vector<Finding>& findings = acceptance.findings;
  const absl::StatusOr<Json> challenges = client.Get("/v1/challenges");
  if (!challenges.ok()) {
    findings.push_back(NotAnswered("phase", challenges.status()));
    return acceptance;
  }
  const Place place = PlaceOf(plan, *challenges);
  if (findings[0].state == FindingState::kOk) {
    findings.push_back(TeamFinding(client, plan, !(*challenges)["challenges"].empty()));
  }
  findings.push_back(place.finding);
  findings.push_back(RulesFinding(client, plan));
  findings.push_back(RuntimesFinding(client, plan));
  if (auto quota = QuotaFinding(client, plan, place.phase)) findings.push_back(*std::move(quota));
  if (auto twin = TwinFinding(client, plan, place.phase)) findings.push_back(*std::move(twin));
  return acceptance;
}

}  // namespace myograde::server
