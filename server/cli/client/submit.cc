#include "server/cli/client/submit.h"

#include <absl/strings/str_cat.h>

#include <iostream>

#include "protocol/base/status_macros.h"
#include "server/artefact/artefact.h"
#include "server/base/http_client.h"
#include "server/base/names.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/base/seed_file.h"
#include "server/cli/client/acceptance.h"
#include "server/cli/client/challenges.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

absl::StatusOr<Json> RequestOf(const SubmitOptions& options) {
  Json request = {{"team", options.team}, {"track", options.track}};
  if (!options.profile.empty()) request["profile"] = options.profile;
  if (!options.phase.empty()) request["phase"] = options.phase;
  if (options.episodes != 0) request["episodes"] = options.episodes;
  if (!options.seeds.empty()) {
    ASSIGN_OR_RETURN(request["seeds"], ReadSeeds(options.seeds));
  }
  return request;
}

// A runtime that the server lacks is told before anything is sent. Servers of before 0.2 can't be
// asked, and refuse it themselves.
absl::Status CheckRuntimes(const std::vector<std::string>& needed, const Client& client) {
  if (needed.empty()) return absl::OkStatus();
  const absl::StatusOr<std::vector<std::string>> offered = OfferedRuntimes(client);
  if (AnsweredCode(offered.status()) == "not_found") return absl::OkStatus();
  if (!offered.ok()) return offered.status();
  const std::string missing = MissingRuntime(needed, *offered);
  if (missing.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(missing, "; nothing was sent"));
}

// Packs the submission and sends it; the artefact's id.
absl::StatusOr<std::string> SendArtefact(const SubmitOptions& options, const Client& client) {
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("submit"));
  const std::string archive = temp.path() + "/artefact.tar";
  ASSIGN_OR_RETURN(
      const ArtefactManifest manifest,
      HostStatus(options.path, PackArtefact(options.path, archive, ArtefactLimits(),
                                            Progress("packing", Progress::Unit::kBytes).Listener(),
                                            options.name)));
  RETURN_IF_ERROR(CheckRuntimes(manifest.runtimes, client));
  Progress progress("sending", Progress::Unit::kBytes);
  ASSIGN_OR_RETURN(const Json answer,
                   client.Upload(absl::StrCat("/v1/artefacts?team=", QueryValue(options.team),
                                              "&track=", QueryValue(options.track)),
                                 archive, [&](int64_t done, int64_t total) {
                                   progress.Show(done, total,
                                                 done < total ? "" : "the daemon checks it");
                                 }));
  const std::string artefact = answer.value("artefact", "");
  if (artefact.empty()) return absl::InternalError("the daemon did not say the artefact's id");
  return artefact;
}

absl::StatusOr<int> ReportWaited(const SubmitOptions& options, const Client& client, int64_t id) {
  const std::string path = absl::StrCat("/v1/submissions/", id);
  ASSIGN_OR_RETURN(const Json status, Follow(client, path, absl::StrCat("submission ", id)));
  ASSIGN_OR_RETURN(const Json result,
                   client.Get(path + (options.json ? "/result" : "/result?episodes=1")));
  const std::string state = status.value("state", "");
  if (options.json) {
    Json both = status;
    both["result"] = result;
    PrintJson(both);
  } else {
    std::cout << Bold(absl::StrCat("Submission ", id, " is ", Harmless(state))) << '\n';
    if (status["reason"].is_string()) {
      std::cout << "  " << Harmless(status["reason"].get<std::string>()) << '\n';
    }
    PrintResult(result, options.full_hashes);
    PrintFaults(result.value("episode_rows", Json::array()));
    std::cout.flush();
  }
  return ExitOfState(state);
}

std::string PhaseText(const Json& submission) {
  if (!submission.value("phase", Json()).is_string()) return "";
  return absl::StrCat(", phase ", Cell(submission, "phase"));
}

void PrintAccepted(const Json& submission, int64_t id) {
  if (submission.value("linked", false)) {
    std::cout << "Submission " << id << " of " << Cell(submission, "team") << " is the ranked "
              << "evaluation of this very policy on this board already; nothing new is played, "
              << "as each policy has one." << std::endl;
    return;
  }
  std::cout << "Submission " << id << " is accepted: " << Cell(submission, "name") << " of "
            << Cell(submission, "team") << ", "
            << CountCell(submission["episodes"], "total", "episode")
            << " of " << Cell(submission, "track") << " in the profile "
            << Cell(submission, "profile")
            << PhaseText(submission)
            << (submission.value("ranked", false) ? "" : " (practice: it does not rank)")
            << std::endl;
}

}  // namespace

absl::Status CheckPlaceGiven(const SubmitOptions& options) {
  if (!options.track.empty() || !options.phase.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      "give the track with --track, or the phase of a challenge with --phase");
}

absl::StatusOr<int> Submit(SubmitOptions options) {
  RETURN_IF_ERROR(CheckPlaceGiven(options));
  const Client client = options.client();
  if (options.track.empty()) {
    ASSIGN_OR_RETURN(const Json phase, FindPhaseOf(client, options.phase));
    options.track = phase.value("track", "");
  }
  // Mistakes that can be found here are reported before anything is sent.
  ASSIGN_OR_RETURN(Json request, RequestOf(options));
  ASSIGN_OR_RETURN(const std::string artefact, SendArtefact(options, client));
  request["artefact"] = artefact;
  ASSIGN_OR_RETURN(const Json submission, client.PostOnce("/v1/submissions", request));
  const int64_t id = submission.value("submission", int64_t{0});
  if (options.json && !options.wait) {
    PrintJson(submission);
    return kDone;
  }
  if (!options.json) PrintAccepted(submission, id);
  if (options.wait) return ReportWaited(options, client, id);
  std::cout << "Follow it with: myograde status " << id << std::endl;
  return kDone;
}

CLI::Option* AddSubmitOptions(CLI::App& verb, SubmitOptions& options) {
  AddPolicyPath(verb, "PATH", options.path);
  verb.add_option("--name", options.name,
                  "Name of the policy on boards, 1 to 64 bytes (default: that of policy.json, of "
                  "the program, or by which the image was saved)")
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
                  "File of seeds to practise on: a JSON array, or one on each line; none of them "
                  "may be ranked")
      ->excludes(phase);
  verb.add_option("--episodes", options.episodes,
                  "Practise on the first N of the track's practice seeds; practice does not rank")
      ->check(CLI::Range(1, 10'000))
      ->excludes(phase);
  CLI::Option* wait = verb.add_flag("--wait", options.wait,
                                    "Wait for the end, show progress and print the result");
  AddFullHashes(verb, options.full_hashes);
  AddDaemonOptions(verb, "submit", options);
  return wait;
}

}  // namespace myograde::server
