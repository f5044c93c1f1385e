#include "server/cli/client/submit.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include <algorithm>
#include <iostream>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/artefact/artefact.h"
#include "server/base/http_client.h"
#include "server/base/names.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

// A sentence on the first of `named` runtimes that the server does not have; "" if it has all.
// Errors as Client::Get.
absl::StatusOr<std::string> MissingRuntime(const Client& client,
                                           const std::vector<std::string>& named) {
  if (named.empty()) return "";
  ASSIGN_OR_RETURN(const Json answer, client.Get("/v1/runtimes"));
  const Json offered = answer.value("runtimes", Json::array());
  std::vector<std::string> names;
  for (const Json& runtime : offered) names.push_back(Cell(runtime, "runtime"));
  for (const std::string& name : named) {
    if (!RowWith(offered, "runtime", name).is_null()) continue;
    return absl::StrCat("policy.json asks for the runtime \"", Sanitized(name),
                        "\", which this server does not have; it has ",
                        names.empty() ? "none" : absl::StrJoin(names, ", "));
  }
  return "";
}

absl::StatusOr<Json> BuildRequest(const SubmitOptions& options) {
  Json request = {{"team", options.team}, {"track", options.track}};
  SetIfGiven(request, "profile", options.profile);
  SetIfGiven(request, "phase", options.phase);
  if (options.episodes != 0) request["episodes"] = options.episodes;
  if (!options.seeds.empty()) {
    ASSIGN_OR_RETURN(request["seeds"], ReadSeeds(options.seeds));
  }
  return request;
}

// Packs the submission and sends it; the artefact's id.
absl::StatusOr<std::string> SendArtefact(const SubmitOptions& options, const Client& client) {
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("submit"));
  const std::string archive = temp.path() + "/artefact.tar";
  ASSIGN_OR_RETURN(
      const PolicyManifest manifest,
      HostStatus(options.path, PackArtefact(options.path, archive, ArtefactLimits(),
                                            Progress("packing", Progress::Unit::kBytes).Listener(),
                                            options.name)));
  // A runtime that the server lacks is told before anything is sent. Servers of before 0.2 can't be
  // asked, and refuse it themselves.
  const absl::StatusOr<std::string> missing = MissingRuntime(client, manifest.runtimes);
  if (!missing.ok() && AnsweredCode(missing.status()) != "not_found") return missing.status();
  if (missing.ok() && !missing->empty()) {
    return absl::InvalidArgumentError(*missing + "; nothing was sent");
  }
  Progress progress("sending", Progress::Unit::kBytes);
  ASSIGN_OR_RETURN(const Json answer,
                   client.Upload("/v1/artefacts" +
                                     BuildQuery({{"team", options.team}, {"track", options.track}}),
                                 archive, progress.Listener("the daemon is checking it")));
  const std::string artefact = answer.value("artefact", "");
  if (artefact.empty()) return absl::InternalError("the daemon's answer has no artefact id");
  return artefact;
}

absl::StatusOr<int> ReportWaited(const SubmitOptions& options, const Client& client,
                                 const Json& submission) {
  const std::string path = Filled(submission, "/v1/submissions/{submission}");
  ASSIGN_OR_RETURN(const Json status,
                   FollowUntil(client, path, Filled(submission, "submission {submission}")));
  ASSIGN_OR_RETURN(const Json result,
                   client.Get(path + (options.json ? "/result" : "/result?episodes=1")));
  const std::string state = status.value("state", "");
  Json both = status;
  both["result"] = result;
  return PrintAnswer(
      both, options.json,
      [&](const Json&) {
        std::cout << Bold(Filled(submission, "Submission {submission} is ") + Sanitized(state))
                  << Filled(status, "\n[  {reason}\n]");
        PrintResult(result, options.full_hashes);
        PrintFaults(result.value("episode_rows", Json::array()));
      },
      ExitOfState(state));
}

void PrintAccepted(const Json& submission) {
  if (submission.value("linked", false)) {
    std::cout << Filled(submission,
                        "Submission {submission} of {team} is already this policy's ranked "
                        "evaluation on this board; nothing new is evaluated, because each policy "
                        "has only one.")
              << std::endl;
    return;
  }
  std::cout << Filled(submission, "Submission {submission} is accepted: {name} of {team}, "
                                  "{episodes.total:episode} of {track} in the profile {profile}"
                                  "[, phase {phase}]")
            << (submission.value("ranked", false) ? "" : " (practice: not ranked)")
            << std::endl;
}

Finding Good(const char* check, std::string found) {
  return {check, FindingState::kOk, std::move(found)};
}

Finding Fails(const char* check, std::string found, std::string todo) {
  return {check, FindingState::kFails, std::move(found), std::move(todo)};
}

// What could not be asked, which is not a fault of the submission.
Finding NotAnswered(const char* check, const absl::Status& status) {
  return {check, FindingState::kUnknown, std::string(status.message()), "try again"};
}

Finding ServerFinding(const Client& client, const Json& whoami) {
  if (whoami.value("role", "") != "public") {
    return Good("server", client.where() + Filled(whoami, " knows you as {caller}, {role}"));
  }
  return Fails("server",
               client.where() + " does not know you, and only members of teams can submit",
               "log in with \"myograde login URL\" and the token that the organisers gave you, or "
               "have them add you to a team");
}

Finding TeamFinding(const Client& client, const SubmissionPlan& plan, bool challenge) {
  const absl::StatusOr<Json> team = client.Get("/v1/teams/" + QueryValue(plan.team));
  if (AnsweredCode(team.status()) == "not_found") {
    if (challenge) {
      return Fails("team",
                   absl::StrCat("the server has no team \"", plan.team, "\" that you belong to"),
                   "\"myograde whoami\" lists your teams; ask the organisers to create the team or "
                   "to add you");
    }
    return Good("team", absl::StrCat("the server shows you no team \"", plan.team,
                                     "\" yet; your first submission creates it, if the name is "
                                     "free"));
  }
  if (!team.ok()) return NotAnswered("team", team.status());
  const std::string name = team->value("team", "");
  if (team->value("banned", false)) {
    return Fails("team", absl::StrCat("the organisers have banned team \"", name, "\""),
                 "ask the organisers");
  }
  const std::string called = name == plan.team ? "" : absl::StrCat(", which is \"", name, "\" now");
  return Good("team", absl::StrCat("you may submit for team \"", plan.team, "\"", called));
}

// `of` has been "paused".
Finding Paused(const Json& of, const std::string& what) {
  return Fails("phase",
               Filled(of, absl::StrCat("the organisers have paused ", what, ": {paused.reason}")),
               "wait until they resume; \"myograde phase status\" shows it");
}

Finding PhaseFinding(const SubmissionPlan& plan, const Json& phase) {
  if (phase.value("paused", Json()).is_object()) return Paused(phase, "phase \"{phase}\"");
  const Json profile = phase.value("profile", Json());
  if (phase.value("track", Json()) != plan.track ||
      (!plan.profile.empty() && profile != plan.profile)) {
    return Fails(
        "phase",
        Filled(phase, "phase \"{phase}\" is of track \"{track}\" in the profile \"{profile}\""),
        "leave --track and --profile out");
  }
  const std::string state = phase.value("state", "");
  if (state == "upcoming") {
    return Fails("phase", Filled(phase, "phase \"{phase}\" opens at {opens_at}"),
                 "submit then, or practise with --episodes");
  }
  if (state != "open") {
    return Fails("phase", Filled(phase, "phase \"{phase}\" closed at {closes_at}"),
                 "see \"myograde phase status\"");
  }
  const Json teams = phase.value("teams", Json());
  if (teams.is_array() && std::find(teams.begin(), teams.end(), plan.team) == teams.end()) {
    return {"phase", FindingState::kWarning,
            absl::StrCat(Filled(phase, "phase \"{phase}\" is for teams that the organisers have "
                                       "named, and \""),
                         plan.team, "\" is not one of them"),
            "ask the organisers, unless one of these names is a former name of your team"};
  }
  return Good("phase",
              Filled(phase, "phase \"{phase}\" of track \"{track}\" is open[ until {closes_at}]"));
}

// The phase, "" for the track itself, and whether it takes this.
std::pair<std::string, Finding> PlaceOf(const SubmissionPlan& plan, const Json& challenges) {
  if (challenges.value("paused", Json()).is_object()) {
    return {plan.phase, Paused(challenges, "all submissions")};
  }
  const std::string track = absl::StrCat("track \"", plan.track, "\"");
  if (plan.practice()) return {"", Good("phase", absl::StrCat("practice on ", track, " is open"))};
  if (!plan.phase.empty()) {
    const Json phase = PhaseIn(challenges, plan.phase);
    if (phase.is_object()) return {plan.phase, PhaseFinding(plan, phase)};
    return {plan.phase, Fails("phase", absl::StrCat("the server has no phase \"", plan.phase, "\""),
                              "\"myograde phase status\" lists the phases")};
  }
  Json last;  // The one that opens or closed last tells most.
  std::vector<std::string> open;
  for (const Json& phase : AllPhases(challenges)) {
    if (phase.value("track", "") != plan.track) continue;
    const bool fits = plan.profile.empty() || phase.value("profile", "") == plan.profile;
    if (fits && phase.value("state", "") == "open") open.push_back(phase.value("phase", ""));
    last = phase;
  }
  if (last.is_null()) return {"", Good("phase", track + " is open, without phases")};
  if (open.empty()) return {last.value("phase", ""), PhaseFinding(plan, last)};
  if (open.size() == 1) return {open[0], PhaseFinding(plan, PhaseIn(challenges, open[0]))};
  return {"", Fails("phase",
                    absl::StrCat(track, " has ", open.size(), " open phases: ",
                                 Sanitized(absl::StrJoin(open, ", "))),
                    "name one with --phase")};
}

// Whether an episode here is one there: by the hash of all rules, budgets and seeds.
Finding RulesFinding(const Client& client, const SubmissionPlan& plan) {
  const absl::StatusOr<Json> tracks = client.Get("/v1/tracks");
  if (!tracks.ok()) return NotAnswered("rules", tracks.status());
  const Json offered = tracks->value("tracks", Json::array());
  const Json track = RowWith(offered, "track", plan.track);
  if (track.is_null()) {
    std::vector<std::string> names;
    for (const Json& one : offered) names.push_back(Cell(one, "track"));
    return Fails("rules", absl::StrCat("the server has no track \"", plan.track, "\""),
                 absl::StrCat("it has ", absl::StrJoin(names, ", ")));
  }
  const std::string wanted =
      plan.profile.empty() ? track.value("default_profile", "") : plan.profile;
  const Json profile = RowWith(track.value("profiles", Json::array()), "profile", wanted);
  if (profile.is_null()) {
    return Fails("rules",
                 Filled(track, "the server's track \"{track}\" has no profile \"") + wanted + "\"",
                 "\"myograde spec\" lists the profiles of this host");
  }
  const std::string there = profile.value("config", "");
  if (there == plan.config) {
    return Good("rules", "the server's rules and budgets are the same as this host's");
  }
  return {"rules", FindingState::kWarning,
          absl::StrCat("the server grades under config ", HashText(there, /*full=*/false),
                       ", this host has ", HashText(plan.config, /*full=*/false),
                       ": results here may differ from the server's"),
          "use the server's version and configs here (--configs)"};
}

// Whether the server offers the runtimes that policy.json names.
Finding RuntimesFinding(const Client& client, const SubmissionPlan& plan) {
  if (plan.runtimes.empty()) return Good("runtimes", "policy.json asks for none");
  const absl::StatusOr<std::string> missing = MissingRuntime(client, plan.runtimes);
  if (!missing.ok()) return NotAnswered("runtimes", missing.status());
  if (missing->empty()) {
    return Good("runtimes", absl::StrCat("the server has ", absl::StrJoin(plan.runtimes, ", ")));
  }
  return Fails("runtimes", *missing,
               "name one that it has in policy.json, put what you need into the submission, or ask "
               "the organisers");
}

// Why nothing is left of one budget; "" while something is.
std::string UsedUp(const Json& place, const std::string& budget, const std::string& next_day) {
  const Json uses = place.value(budget, Json::object());
  const std::pair<const char*, std::string> spans[] = {
      {"per_day", " today; the next day begins at " + next_day}, {"total", " in all"}};
  for (const auto& [span, words] : spans) {
    const Json use = uses.value(span, Json());
    if (!use.is_object() || use.value("left", int64_t{1}) > 0) continue;
    const int64_t limit = use.value("limit", int64_t{0}) + use.value("granted", int64_t{0});
    return absl::StrCat("the quota of ",
                        budget == "failed" ? "failed tries" : budget + " submissions",
                        " is used up: ", limit, " of ", limit, words);
  }
  return "";
}

Finding QuotaAt(const Json& quota, const Json& place, const std::string& budget) {
  for (const std::string& one : {budget, std::string("failed")}) {
    const std::string used_up = UsedUp(place, one, Cell(quota, "next_day_at"));
    if (used_up.empty()) continue;
    return Fails("quota", used_up,
                 "organisers can grant more; \"myograde quota\" shows what was used");
  }
  const Json waiting = place.value("waiting", Json::object());
  if (waiting.value("used", int64_t{0}) >= waiting.value("limit", int64_t{1})) {
    return Fails("quota",
                 Filled(waiting, "the team already has {used:evaluation} waiting, which is the "
                                 "limit"),
                 "wait until one has ended");
  }
  return Good("quota",
              Filled(place.value(budget, Json::object()),
                     absl::StrCat("{per_day.left} ", budget,
                                  " submissions are left today, {total.left} in all")));
}

// Nothing if the server knows no such team, which then has used nothing.
void AddQuotaFinding(const Client& client, const SubmissionPlan& plan, const std::string& phase,
                     std::vector<Finding>& findings) {
  const absl::StatusOr<Json> quota = client.Get(
      "/v1/quota" + BuildQuery({{"team", plan.team}, {"track", plan.track}, {"limit", "1"}}));
  const std::string code = AnsweredCode(quota.status());
  if (code == "not_found" || code == "unknown_track") return;
  if (!quota.ok()) return findings.push_back(NotAnswered("quota", quota.status()));
  const Json place =
      phase.empty() ? RowWith(quota->value("tracks", Json::array()), "track", plan.track)
                    : RowWith(quota->value("phases", Json::array()), "phase", phase);
  if (place.is_null()) return;
  findings.push_back(QuotaAt(*quota, place, plan.practice() ? "practice" : "official"));
}

// Whether this policy is ranked there already: nothing would be played again.
void AddTwinFinding(const Client& client, const SubmissionPlan& plan, const std::string& phase,
                    std::vector<Finding>& findings) {
  if (plan.practice() || plan.artefact.empty()) return;
  const absl::StatusOr<Json> answer = client.Get(
      "/v1/submissions" +
      BuildQuery(
          {{"team", plan.team}, {"track", plan.track}, {"limit", "1000"}, {"phase", phase}}));
  if (!answer.ok()) return;  // the team's finding says why
  for (const Json& submission : answer->value("submissions", Json::array())) {
    const bool same_rules = plan.profile.empty() || TextAt(submission, "profile") == plan.profile;
    const bool twin = TextAt(submission, "artefact") == plan.artefact && same_rules;
    if (!twin || !submission.value("ranked", false)) continue;
    return findings.push_back(
        {"novelty", FindingState::kWarning,
         Filled(submission, "this policy is already submission {submission} of the team, which is "
                            "{state}; a ranked policy is evaluated only once"),
         "see \"myograde show ID\"; change the policy, or rerun that submission"});
  }
}

}  // namespace

absl::Status CheckPlaceGiven(const SubmitOptions& options) {
  return RefuseIf({{options.track.empty() && options.phase.empty(),
                    "give a track with --track, or a phase of a challenge with --phase"}});
}

absl::StatusOr<int> Submit(SubmitOptions options) {
  RETURN_IF_ERROR(CheckPlaceGiven(options));
  const Client client = options.client();
  if (options.track.empty()) {
    ASSIGN_OR_RETURN(const Json phase, FindPhaseOf(client, options.phase));
    options.track = phase.value("track", "");
  }
  // Mistakes that can be found here are reported before anything is sent.
  ASSIGN_OR_RETURN(Json request, BuildRequest(options));
  ASSIGN_OR_RETURN(request["artefact"], SendArtefact(options, client));
  ASSIGN_OR_RETURN(const Json submission,
                   client.Post("/v1/submissions", request, /*once=*/true));
  if (options.wait) {
    if (!options.json) PrintAccepted(submission);
    return ReportWaited(options, client, submission);
  }
  return PrintAnswer(submission, options.json, [](const Json& accepted) {
    PrintAccepted(accepted);
    std::cout << Filled(accepted, "Follow it with: myograde status {submission}") << std::endl;
  });
}

bool AskAcceptance(const Client& client, const SubmissionPlan& plan,
                   std::vector<Finding>& findings) {
  const absl::StatusOr<Json> whoami = client.Get("/v1/whoami");
  if (!whoami.ok()) {
    // A refusal is an answer: the token is bad.
    const bool refused = whoami.status().code() == absl::StatusCode::kInvalidArgument;
    findings.push_back({"server", refused ? FindingState::kFails : FindingState::kUnknown,
                        std::string(whoami.status().message()),
                        refused ? "log in again with \"myograde login URL\""
                                : "team, phase, rules, runtimes and quota are not checked"});
    return refused;
  }
  findings.push_back(ServerFinding(client, *whoami));
  const bool known = findings.back().state == FindingState::kOk;
  const absl::StatusOr<Json> challenges = client.Get("/v1/challenges");
  if (!challenges.ok()) {
    findings.push_back(NotAnswered("phase", challenges.status()));
    return true;
  }
  const auto [phase, open] = PlaceOf(plan, *challenges);
  if (known) findings.push_back(TeamFinding(client, plan, !(*challenges)["challenges"].empty()));
  findings.push_back(open);
  findings.push_back(RulesFinding(client, plan));
  findings.push_back(RuntimesFinding(client, plan));
  AddQuotaFinding(client, plan, phase, findings);
  AddTwinFinding(client, plan, phase, findings);
  return true;
}

CLI::Option* AddSubmitOptions(CLI::App& verb, SubmitOptions& options) {
  AddPolicyPath(verb, "PATH", options.path);
  verb.add_option("--name", options.name,
                  "Name of the policy on boards, 1 to 64 bytes (default: that of policy.json, of "
                  "the program, or of the saved image)")
      ->check([](const std::string& name) {
        return std::string(CleanName(name, "it").status().message());
      });
  verb.add_option("--track", options.track,
                  "Name of the track, as \"myograde spec\" lists them (default: the phase's)");
  verb.add_option("--team", options.team, "Name of the team; 1 to 64 bytes")->required();
  verb.add_option("--profile", options.profile, "Rules profile (default: the track's own)");
  CLI::Option* phase =
      verb.add_option("--phase", options.phase,
                      "Phase of a challenge (default: the only one of the track that is open)");
  verb.add_option("--seeds", options.seeds,
                  "File of seeds to practise on: a JSON array, or one seed a line; none may be "
                  "ranked")
      ->excludes(phase);
  verb.add_option("--episodes", options.episodes,
                  "Practise on the first N of the track's practice seeds; practice is not ranked")
      ->check(CLI::Range(1, 10'000))
      ->excludes(phase);
  CLI::Option* wait = verb.add_flag("--wait", options.wait,
                                    "Wait for the end, show progress and print the result");
  AddFullHashes(verb, options.full_hashes);
  AddDaemonOptions(verb, "submit", options);
  return wait;
}

}  // namespace myograde::server
