#include "server/cli/offline/local.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/outcome.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/files.h"
#include "server/cli/base/report.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"
#include "server/config/server_config.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/runner/log_keeper.h"
#include "server/runtime/runtimes.h"
#include "server/sandbox/program.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

absl::StatusOr<std::vector<uint64_t>> SeedsOf(const LocalOptions& options,
                                              const TrackConfig& config) {
  std::vector<uint64_t> seeds = config.seeds;
  if (!options.seeds.empty()) {
    ASSIGN_OR_RETURN(seeds, ReadSeeds(options.seeds));
  }
  RETURN_IF_ERROR(RefuseIf(
      {{options.episodes > std::ssize(seeds),
        absl::StrCat("--episodes: ", options.episodes,
                     " are asked for, but the seed list has only ", seeds.size())}}));
  if (options.episodes > 0) seeds.resize(static_cast<size_t>(options.episodes));
  return seeds;
}

// Everything that can be wrong with what the user gave is found here, before
// anything runs. `temp` keeps the unpacked submission.
absl::StatusOr<LocalOrder> Prepare(const LocalOptions& options, const std::string& temp) {
  ASSIGN_OR_RETURN(LocalOrder order, MakeLocalOrder(options));
  RETURN_IF_ERROR(TakeSubmission(options.path, /*name=*/"", temp, order));
  RETURN_IF_ERROR(TakeRuntimes(order));
  RETURN_IF_ERROR(CheckLocalProgram(options.path, order));
  if (!options.logs.empty()) {
    std::error_code error;
    order.log_dir = std::filesystem::absolute(options.logs).lexically_normal();
    std::filesystem::create_directories(order.log_dir, error);
    if (error) {
      return absl::InvalidArgumentError(
          absl::StrCat("--logs: ", options.logs, " can't be made: ", error.message()));
    }
  }
  return order;
}

// Names the logs in `folder` after their episodes, and says so in `rows`. The runner names them by
// their hashes.
absl::Status NameLogs(const std::string& folder, Json& rows) {
  namespace fs = std::filesystem;
  if (folder.empty() || rows.empty()) return absl::OkStatus();
  const auto width = static_cast<int>(std::to_string(rows.back()["index"].get<int64_t>()).size());
  for (Json& row : rows) {
    if (!row["log"].is_object() || row["log"].value("sha256", "").empty()) continue;
    const std::string name =
        absl::StrFormat("episode-%0*d.lcmlog.zst", std::max(3, width), row["index"].get<int64_t>());
    std::error_code error;
    fs::rename(fs::path(folder) / LogFileName(row["log"].value("sha256", "")),
               fs::path(folder) / name, error);
    if (error) {
      return absl::InternalError(
          absl::StrCat(folder, "/", name, ": can't be made: ", error.message()));
    }
    row["log"]["file"] = name;
  }
  return absl::OkStatus();
}

absl::StatusOr<Json> ResultJson(const LocalOrder& order, const LocalResult& result,
                                absl::Duration wall) {
  const scoring::TrackScoring& scoring = order.track->scoring;
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate, AggregateRows(*scoring.track, result.rows));
  const TrackConfig& config = order.track->config;
  std::map<std::string, int64_t> outcomes;
  std::map<std::string, int64_t> reasons;
  Json rows = Json::array();
  for (const EpisodeRow& row : result.rows) {
    ++outcomes[std::string(OutcomeName(row.outcome))];
    if (row.reason != FailureReason::kNone) ++reasons[std::string(row.reason.name())];
    rows.push_back(LocalRowJson(row));
  }
  const char* state = result.interrupted ? "cancelled" : aggregate.failed ? "failed" : "done";
  return Json{{"track", config.id},
              {"track_kind", config.kind->name},
              {"profile", config.profile},
              {"state", state},
              {"name", order.artefact.manifest.name},
              {"planned", order.seeds.size()},
              {"aggregate", AggregateToJson(*scoring.track, aggregate)},
              {"official_figures", scoring.official_figures},
              {"metrics", ShownMetrics(scoring)},
              {"outcomes", outcomes},
              {"reasons", reasons},
              {"hashes",
               {{"artefact", order.artefact.digest},
                {"config", config.hash},
                {"seeds", Sha256Hex(CanonicalJson(order.seeds))},
                {"results", ResultsHash(result.rows, config.seed_salt)}}},
              {"merkle_root", result.rows.empty()
                                  ? Json()
                                  : Json(MerkleRootOf(result.rows, config.seed_salt))},
              {"grader", WithRuntimes(GraderBuild(order.cache_dir, {order.artefact.manifest.adapter}),
                                       RuntimeDigests(Runtimes(order.config.runtimes,
                                                               order.config.runtimes_dir),
                                                      order.artefact.manifest.runtimes))},
              {"episode_rows", rows},
              {"output", result.outputs},
              {"wall", {{"slots", order.slots}, {"wall_s", absl::ToDoubleSeconds(wall)}}}};
}

}  // namespace

absl::StatusOr<ServerConfig> ServerConfigOf(const HostOptions& host) {
  return HostStatus("", LoadServerConfig(host.configs_dir() + "/server.json", host.cache_dir()));
}

absl::StatusOr<LocalOrder> MakeLocalOrder(const LocalOptions& options) {
  LocalOrder order;
  const std::string configs = options.host.configs_dir();
  ASSIGN_OR_RETURN(
      TrackConfig config,
      HostStatus("", LoadTrackConfig(configs + "/tracks", options.track, options.profile)));
  ASSIGN_OR_RETURN(order.seeds, SeedsOf(options, config));
  ASSIGN_OR_RETURN(order.track, HostStatus("", MakeTrack(std::move(config))));
  order.cache_dir = options.host.cache_dir();
  ASSIGN_OR_RETURN(order.config, ServerConfigOf(options.host));
  RETURN_IF_ERROR(HostStatus("", LoadSandboxConfig(configs).status()));
  order.slots = options.slots > 0 ? options.slots : order.config.scheduler.slots;
  return order;
}

absl::Status TakeSubmission(const std::string& path, const std::string& name,
                            const std::string& temp, LocalOrder& order) {
  const TrackConfig& track = order.track->config;
  const ArtefactLimits limits = {.bytes = track.budgets.submission_bytes,
                                 .files = track.budgets.submission_files};
  const std::string archive = temp + "/artefact.tar";
  RETURN_IF_ERROR(
      HostStatus(path, PackArtefact(path, archive, limits,
                                    Progress("packing", Progress::Unit::kBytes).Listener(), name)
                           .status()));
  order.artefact_dir = temp + "/artefact";
  ASSIGN_OR_RETURN(
      order.artefact,
      HostStatus(path, UnpackArtefact(archive, order.artefact_dir, limits,
                                      Progress("unpacking", Progress::Unit::kBytes).Listener())));
  const ArtefactManifest& manifest = order.artefact.manifest;
  RETURN_IF_ERROR(HostStatus(path, CheckAdapter(manifest.adapter, *track.kind)));
  RETURN_IF_ERROR(HostStatus(path, CheckExtraObservations(manifest.extra_observations, track)));
  order.work_dir = temp;
  std::filesystem::remove(archive);
  return absl::OkStatus();
}

absl::Status TakeRuntimes(LocalOrder& order) {
  const Runtimes runtimes(order.config.runtimes, order.config.runtimes_dir);
  for (const std::string& name : order.artefact.manifest.runtimes) {
    absl::StatusOr<Runtime> runtime = runtimes.Find(name);
    if (absl::IsNotFound(runtime.status())) {
      return absl::InvalidArgumentError(absl::StrCat(
          "policy.json asks for the runtime \"", name, "\"; known: ",
          absl::StrJoin(runtimes.List(), ", ", [](std::string* out, const Runtime& entry) {
            out->append(entry.name);
          })));
    }
    if (!runtime.ok()) return runtime.status();
    order.runtimes.push_back(std::move(runtime->folder));
  }
  return absl::OkStatus();
}

absl::Status CheckLocalProgram(const std::string& path, const LocalOrder& order) {
  return HostStatus(path,
                    CheckProgram(order.artefact.manifest, order.artefact_dir, order.runtimes));
}

Json LocalRowJson(const EpisodeRow& row) {
  const Json facts = Json::parse(row.facts_json);
  Json json = {{"index", row.index},
               {"seed", row.seed},
               {"outcome", OutcomeName(row.outcome)},
               {"reason", row.reason.name()},
               {"metrics", Json::parse(row.metrics_json)},
               {"facts", facts},
               {"details", row.details_json.empty() ? Json() : Json::parse(row.details_json)}};
  const std::pair<const char*, const char*> copied[] = {
      {"steps", "steps"}, {"sim_time", "sim_time_s"}, {"clipped", "clipped"}, {"digest", "digest"},
      {"actions_digest", "actions_digest"},  {"log", "log"},
      {"end", "end"},     {"fault", "fault"},         {"wall_s", "wall_s"},
      {"policy_cpu_s", "policy_cpu_s"}};
  for (const auto& [from, to] : copied) json[to] = facts.value(from, Json());
  return json;
}

absl::StatusOr<LocalGrade> GradeLocally(const LocalOptions& options) {
  CatchStopSignals();
  const absl::Duration start = SystemClock().Monotonic();
  ASSIGN_OR_RETURN(TempFolder temp, TempFolder::Make("local"));
  ASSIGN_OR_RETURN(LocalOrder order, Prepare(options, temp.path()));
  ASSIGN_OR_RETURN(LocalResult result, PlayLocally(order, options.track, /*tell_replays=*/true));
  ASSIGN_OR_RETURN(Json json, ResultJson(order, result, SystemClock().Monotonic() - start));
  RETURN_IF_ERROR(NameLogs(order.log_dir, json["episode_rows"]));
  json["episodes"] = json["episode_rows"];  // as it was called at first
  return LocalGrade{std::move(json), std::move(result.rows), order.track, result.interrupted};
}

void PrintLocalGrade(const Json& json, bool full_hashes) {
  std::cout << Bold(Filled(json, "{name} on {track}, profile {profile}: {state}")) << '\n';
  PrintResult(json, full_hashes);
  PrintEpisodes(json["episode_rows"], json["metrics"], full_hashes);
  std::cout << "took " << DurationText(json["wall"]["wall_s"].get<double>()) << std::endl;
}

int ExitOfLocalGrade(const LocalGrade& grade) {
  if (grade.interrupted) PrintToErrors("myograde: interrupted");
  return grade.json["state"] == "done" ? kDone : kNoScore;
}

void AddLocalOptions(CLI::App& verb, LocalOptions& options, const std::string& path_name,
                     const std::string& schema) {
  AddPolicyPath(verb, path_name, options.path);
  verb.add_option("--profile", options.profile, "Rules profile (default: the track's own)");
  AddFullHashes(verb, options.full_hashes);
  AddJson(verb, schema, options.json);
  AddHostOptions(verb, options.host);
}

Action AddLocal(CLI::App& verb) {
  auto options = std::make_shared<LocalOptions>();
  AddLocalOptions(verb, *options, "PATH", "local");
  verb.add_option("--track", options->track, "Name of the track, as \"myograde spec\" lists them")
      ->required();
  verb.add_option("--seeds", options->seeds,
                  "File of seeds in place of the track's list: a JSON array, or one on each line");
  verb.add_option("--episodes", options->episodes, "Play only the first N seeds")
      ->check(CLI::Range(1, 10'000));
  verb.add_option("--logs", options->logs,
                  "Folder for the log of each episode, episode-000.lcmlog.zst and so on, which \"myograde "
                  "replay\" plays again and \"myograde render\" shows");
  verb.add_option("--slots", options->slots,
                  "Blocks of episodes to play at a time (default: as in server.json, one for each "
                  "processor)")
      ->check(CLI::Range(1, 1024));
  return [options]() -> absl::StatusOr<int> {
    ASSIGN_OR_RETURN(const LocalGrade grade, GradeLocally(*options));
    const auto print = [&](const Json& json) { PrintLocalGrade(json, options->full_hashes); };
    return PrintAnswer(grade.json, options->json, print, ExitOfLocalGrade(grade));
  };
}

}  // namespace myograde::server
