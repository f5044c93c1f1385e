#include "server/cli/offline/local.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <thread>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/cli/base/files.h"
#include "server/cli/terminal/terminal.h"
#include "server/grading/results.h"
#include "server/runner/lease_report.h"
#include "server/runner/runner_process.h"
#include "server/runtime/runtimes.h"
#include "server/sandbox/program.h"
#include "server/sandbox/sandbox_config.h"
#include "server/sandbox/slot_processes.h"

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
                     " were requested, but the seed list has only ", seeds.size())}}));
  if (options.episodes > 0) seeds.resize(static_cast<size_t>(options.episodes));
  return seeds;
}

constexpr int kPollMilliseconds = 100;

Json OutputJson(int64_t first, int64_t last, const LeaseEndRecord& end,
                const std::vector<EpisodeRow>& rows) {
  Json use = {{"policy_cpu_s", end.policy_cpu_s},
              {"simulator_cpu_s", end.simulator_cpu_s},
              {"wall_s", end.wall_s},
              {"peak_memory_bytes", end.peak_memory_bytes}};
  AddStartUp(rows, first, last, use);
  return {{"first", first},
          {"last", last},
          {"stdout_tail", end.stdout_tail},
          {"stderr_tail", end.stderr_tail},
          {"stdout_truncated", end.stdout_truncated},
          {"stderr_truncated", end.stderr_truncated},
          {"usage_wall_cpu", std::move(use)}};
}

class LocalRun {
 public:
  LocalRun(const LocalOrder& order, const std::string& what, bool report_retries)
      : order_(order), report_retries_(report_retries), progress_(what) {}

  absl::StatusOr<LocalResult> Run() {
    const int64_t total = std::ssize(order_.seeds);
    const int64_t block = order_.track->config.episodes_per_lease;
    for (int64_t first = 0; first < total; first += block) {
      Lease& lease = leases_.emplace_back();
      lease.first = first;
      lease.last = std::min(first + block, total) - 1;
    }
    for (;;) {
      if (StopRequested()) {
        KillAll();
        return Collect(/*interrupted=*/true);
      }
      absl::Status status = StartWaiting();
      WaitForRecords();
      int64_t done = 0;
      bool all_done = true;
      for (Lease& lease : leases_) {
        if (lease.runner != nullptr) Listen(lease);
        if (status.ok() && lease.runner != nullptr && lease.runner->finished()) {
          Listen(lease);
          status = Finish(lease);
        }
        done += std::ssize(lease.rows);
        all_done = all_done && lease.done;
      }
      progress_.Show(done, total, "");
      if (!status.ok()) {
        KillAll();
        return status;
      }
      if (all_done) return Collect(/*interrupted=*/false);
    }
  }

 private:
  struct Lease {
    int64_t first = 0;
    int64_t last = 0;
    int64_t faults = 0;
    absl::Duration not_before;  // of the next try
    std::unique_ptr<RunnerProcess> runner;
    int slot = -1;
    std::string work_dir;
    LeaseReport report;  // of this try
    std::map<int64_t, EpisodeRow> rows;
    bool done = false;
  };

  LeaseOrder OrderFor(const Lease& lease) const {
    const TrackConfig& track = order_.track->config;
    return MakeLeaseOrder(
        absl::StrCat("local-", lease.first, "-", lease.faults), track,
        EpisodesOf(track, order_.seeds, lease.first, lease.last),
        {.artefact_dir = order_.artefact_dir,
         .command = order_.artefact.manifest.command,
         .environment = order_.artefact.manifest.environment,
         .runtimes = order_.runtimes,
         .adapter = order_.artefact.manifest.adapter,
         .extra_observations = ShowsExtraObservations(
             order_.artefact.manifest.extra_observations, !order_.artefact.manifest.adapter.empty(),
             track),
         .image = order_.artefact.manifest.image},
        {.slot = lease.slot,
         .uid = ::geteuid() == 0 ? order_.config.uid_base + kLocalUsers + lease.slot : -1,
         .pinned = PinsSlots(order_.config, order_.slots, track),
         .work_dir = lease.work_dir,
         .cache_dir = order_.cache_dir,
         .log_dir = order_.log_dir});
  }

  absl::Status StartWaiting() {
    const absl::Duration now = SystemClock().Monotonic();
    std::set<int> free;
    for (int slot = 0; slot < order_.slots; ++slot) free.insert(slot);
    for (const Lease& lease : leases_) free.erase(lease.slot);
    for (Lease& lease : leases_) {
      if (free.empty()) break;
      if (lease.done || lease.runner != nullptr || lease.not_before > now) continue;
      RETURN_IF_ERROR(Start(lease, free.extract(free.begin()).value()));
    }
    return absl::OkStatus();
  }

  absl::Status Start(Lease& lease, int slot) {
    lease.slot = slot;
    lease.work_dir = absl::StrCat(order_.work_dir, "/lease-", lease.first, "-", lease.faults);
    std::error_code error;
    if (!std::filesystem::create_directory(lease.work_dir, error)) {
      return absl::InternalError(
          absl::StrCat(lease.work_dir, ": can't be created: ", error.message()));
    }
    const LeaseOrder order = OrderFor(lease);
    absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
    if (!runner.ok()) return absl::InternalError(runner.status().message());
    lease.runner = *std::move(runner);
    const absl::Duration now = SystemClock().Monotonic();
    const absl::Duration budget = absl::Seconds(order.track.budgets.lease_wall_s);
    lease.report = LeaseReport(order.episodes,
                               {.deadline = now + budget + order_.config.lease_grace,
                                .silence = order_.config.scheduler.heartbeat},
                               now);
    return absl::OkStatus();
  }

  void WaitForRecords() {
    std::vector<pollfd> fds;
    for (const Lease& lease : leases_) {
      if (lease.runner == nullptr) continue;
      for (const int fd : {lease.runner->stdout_fd(), lease.runner->stderr_fd()}) {
        if (fd >= 0) fds.push_back({fd, POLLIN, 0});
      }
    }
    // An interrupt or an error only ends the wait early; the loop looks again.
    ::poll(fds.data(), fds.size(), kPollMilliseconds);
  }

  void Listen(Lease& lease) {
    const absl::Duration now = SystemClock().Monotonic();
    absl::StatusOr<std::vector<LeaseRecord>> records = lease.runner->Read();
    if (!records.ok()) {
      lease.report.Fail(std::string(records.status().message()));
    } else {
      const LeaseReport::News news = lease.report.Take(*records, now);
      for (const EpisodeFacts& facts : news.episodes) {
        absl::StatusOr<EpisodeRow> row = JudgedRow(*order_.track, facts);
        if (!row.ok()) {
          lease.report.Fail(std::string(row.status().message()));
        } else {
          lease.rows.try_emplace(facts.index, *std::move(row));  // what an earlier try told stays
        }
      }
    }
    lease.report.Tick(now);
    if (lease.report.faulty() || lease.report.lingers(now)) lease.runner->Kill();
  }

  absl::Status Finish(Lease& lease) {
    lease.report.Conclude(lease.runner->wait_status(), lease.runner->stderr_tail());
    lease.runner.reset();
    lease.slot = -1;
    std::error_code ignored;  // the whole folder is removed at the end again
    std::filesystem::remove_all(lease.work_dir, ignored);
    if (!lease.report.faulty()) {
      lease.done = true;
      return absl::OkStatus();
    }
    const std::string episodes = absl::StrCat("episodes ", lease.first, " to ", lease.last);
    if (++lease.faults > order_.config.scheduler.max_retries) {
      return absl::InternalError(
          absl::StrCat(episodes,
                       " failed because of a fault of the grader: ", lease.report.fault()));
    }
    // What disturbed it may take a while to go.
    const auto doubled = static_cast<double>(int64_t{1} << std::min<int64_t>(lease.faults - 1, 20));
    lease.not_before = SystemClock().Monotonic() + order_.config.scheduler.retry_delay * doubled;
    if (report_retries_) {
      std::cerr << "myograde: " << episodes << " are retried after a fault of the grader: "
                << lease.report.fault() << std::endl;
    }
    return absl::OkStatus();
  }

  void KillAll() {
    std::vector<std::thread> killers;  // a Kill takes up to a second; all together too
    for (Lease& lease : leases_) {
      if (lease.runner != nullptr) killers.emplace_back([&lease] { lease.runner->Kill(); });
    }
    for (std::thread& killer : killers) killer.join();
  }

  LocalResult Collect(bool interrupted) const {
    LocalResult result;
    result.interrupted = interrupted;
    result.outputs = Json::array();
    for (const Lease& lease : leases_) {
      for (const auto& [index, row] : lease.rows) result.rows.push_back(row);
      if (lease.report.end().has_value()) {
        result.outputs.push_back(
            OutputJson(lease.first, lease.last, *lease.report.end(), result.rows));
      }
    }
    return result;
  }

  const LocalOrder& order_;
  const bool report_retries_;
  Progress progress_;
  std::vector<Lease> leases_;
};

}  // namespace

absl::StatusOr<ServerConfig> BuildServerConfig(const HostOptions& host) {
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
  ASSIGN_OR_RETURN(order.config, BuildServerConfig(options.host));
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
  const PolicyManifest& manifest = order.artefact.manifest;
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

absl::StatusOr<LocalResult> PlayLocally(const LocalOrder& order, const std::string& what,
                                        bool report_retries) {
  return LocalRun(order, what, report_retries).Run();
}

}  // namespace myograde::server
