#include "server/daemon/daemon.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <memory>
#include <thread>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/admission/admission.h"
#include "server/api/api.h"
#include "server/artefact/adapters.h"
#include "server/base/service_manager.h"
#include "server/base/paths.h"
#include "server/challenge/phases.h"
#include "server/daemon/lease_hosts.h"
#include "server/daemon/log.h"
#include "server/daemon/start.h"
#include "server/engine/engine.h"
#include "server/engine/rejudges.h"
#include "server/engine/retention.h"
#include "server/engine/standings.h"
#include "server/metrics/metrics.h"
#include "server/pictures/picture_source.h"
#include "server/pictures/pictures.h"
#include "server/proof/grader_build.h"
#include "server/proof/reference_check.h"
#include "server/proof/signing_key.h"
#include "server/runtime/runtimes.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/delegated_group.h"
#include "server/sandbox/stage.h"
#include "server/sandbox/users.h"
#include "server/store/lock.h"
#include "server/webhook/sender.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// A stop is bounded: a second for the leases, then this for everything else; a cluster's jobs are
// cancelled in it.
constexpr absl::Duration kLeaveWithin = absl::Seconds(3);
constexpr absl::Duration kLeaveClusterWithin = absl::Seconds(10);

// Of a service manager's patience; twice is what sd_watchdog_enabled(3) recommends at least.
constexpr double kBeatsPerWatchdog = 4;

// What a crowd's answers needed goes back to the system: free memory between used one stays with the
// process otherwise. Takes milliseconds.
constexpr absl::Duration kTrimEvery = absl::Seconds(10);

// The data folder is private to the daemon: it holds the secret and everybody's submissions.
absl::Status MakeFolders(const std::string& data) {
  std::error_code error;
  for (const char* part : {"", "/artefacts", "/logs", "/pictures", "/selftest", "/slots", "/spool", "/work"}) {
    const std::string path = data + part;
    if (!error) fs::create_directory(path, error);
    // The slots' users must be able to read the self-test's artefact, like any other.
    const bool shown = path.ends_with("/selftest");
    const fs::perms rights = shown ? fs::perms(0755) : fs::perms::owner_all;
    if (!error) fs::permissions(path, rights, error);
    if (error) {
      return absl::PermissionDeniedError(absl::StrCat(
          path, ": can't be made or given its rights (", error.message(),
          "); choose another data folder with --data"));
    }
  }
  return absl::OkStatus();
}

// Work in progress of an earlier daemon that died is useless.
void Empty(const std::string& folder) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    fs::remove_all(entry.path(), error);
    if (error) spdlog::warn("{}: can't be removed: {}", entry.path().string(), error.message());
  }
}

// Drafts of episode logs that were being written; finished logs have other names.
void RemoveDrafts(const std::string& folder) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().filename().string().starts_with(".draft-")) fs::remove(entry.path(), error);
  }
}

std::atomic<Engine*> engine_to_stop = nullptr;
std::atomic<UnixHttpServer*> server_to_stop = nullptr;

void OnReload(int) {
  const int error = errno;
  if (UnixHttpServer* server = server_to_stop.load()) server->ReloadCertificate();
  errno = error;
}

void OnSignal(int) {
  const int error = errno;
  if (Engine* engine = engine_to_stop.load()) engine->Stop();
  if (UnixHttpServer* server = server_to_stop.load()) server->BeginStop();
  errno = error;
}

// While this object lives, signals stop the engine, and the server once there is one.
class SignalGuard {
 public:
  explicit SignalGuard(Engine& engine) {
    engine_to_stop = &engine;
    struct sigaction action = {};
    action.sa_handler = OnSignal;
    for (const int signal : {SIGTERM, SIGINT}) sigaction(signal, &action, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
    // If inherited as ignored, it would hide the children's exits.
    std::signal(SIGCHLD, SIG_DFL);
  }
  ~SignalGuard() {
    server_to_stop = nullptr;
    engine_to_stop = nullptr;
  }
};

// While this object lives, the file `path` says where the network finds the daemon, and SIGHUP has
// the certificate read again; without a door to the network, neither.
class NetworkGuard {
 public:
  NetworkGuard(std::string path, const std::string& url) : path_(std::move(path)) {
    std::error_code error;
    fs::remove(path_, error);  // of a daemon that was killed
    if (url.empty()) return;
    const absl::Status written = WriteFile(path_ + ".part", url + "\n");
    if (written.ok()) fs::rename(path_ + ".part", path_, error);
    if (!written.ok() || error) spdlog::warn("{}: can't be written", path_);
    struct sigaction action = {};
    action.sa_handler = OnReload;
    sigaction(SIGHUP, &action, nullptr);
  }
  ~NetworkGuard() {
    std::error_code error;
    fs::remove(path_, error);
  }
  NetworkGuard(const NetworkGuard&) = delete;
  NetworkGuard& operator=(const NetworkGuard&) = delete;

 private:
  const std::string path_;
};

// Ends the process after a while if it is still alive: everything that must be written has been,
// and a hanging thread (on a slow disk, say) must not keep the host from shutting down.
void EndSoon(int exit_status, absl::Duration within) {
  std::thread([exit_status, within] {
    std::this_thread::sleep_for(absl::ToChronoMilliseconds(within));
    spdlog::warn("stopped without waiting for hanging threads");
    std::_Exit(exit_status);
  }).detach();
}

// Makes room for the sandboxes' control groups, and says what an ordinary user lacks for sandboxes.
void CheckSandboxes(const ServerConfig& config) {
  if (config.on_cluster) return;
  if (const absl::Status status = DivideDelegatedGroup(); !status.ok()) {
    spdlog::warn("{}", std::string(status.message()));
  }
  if (geteuid() == 0 || CanMakeUserNamespace()) return;
  spdlog::error(
      "this host lets the daemon's user (uid {}) make no user namespaces, so nothing can be graded: set "
      "user.max_user_namespaces, and kernel.unprivileged_userns_clone=1 where the kernel has it, with "
      "sysctl, or run the daemon as root",
      geteuid());
}

// Raises the limit to the number of descriptors that the config may use.
absl::Status RaiseDescriptorLimit(const ServerConfig& config) {
  const auto needed = static_cast<rlim_t>(DescriptorsNeeded(config));
  rlimit limit = {};
  getrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_cur >= needed) return absl::OkStatus();
  const rlim_t allowed = limit.rlim_max;
  limit = {needed, std::max(needed, allowed)};
  if (setrlimit(RLIMIT_NOFILE, &limit) == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "server.json: ", config.scheduler.slots, " slots, ", config.http.clients, " clients and ",
      config.http.workers, " workers may need ", needed, " open files at once, and this process ",
      "may have ", allowed, "; raise that (ulimit -n, LimitNOFILE= of a service), or lower one of ",
      "the three"));
}

// Whoever lost the store should hear of it before the next submission gets number 1.
void WarnOfLostStore(const std::string& data_dir, const std::string& path) {
  std::error_code error;
  const std::string artefacts = data_dir + "/artefacts";
  const bool there = std::filesystem::exists(path, error) && std::filesystem::file_size(path, error) > 0;
  if (there || std::filesystem::is_empty(artefacts, error)) return;
  spdlog::error("{} is not there, or empty, so an empty store is made, though {} has the files of "
                "submissions; if it was lost, stop the daemon and restore it from a backup", path, artefacts);
}

}  // namespace

absl::StatusOr<std::string> AdoptData(const std::string& data_dir) {
  const std::string path = data_dir + "/store.db";
  if (access(path.c_str(), F_OK) != 0) {
    return absl::NotFoundError(
        absl::StrCat(path, ": there is no store; name a daemon's data folder with --data"));
  }
  ASSIGN_OR_RETURN(const DataLock lock, DataLock::Take(data_dir));
  RETURN_IF_ERROR(Store::Open(path, SystemClock()).status());
  ASSIGN_OR_RETURN(const HomeFound found, FindHome(data_dir, /*on_cluster=*/true, /*adopt=*/true));
  return absl::StrCat("The store is at home in ", found.home.place,
                      " now; start the daemon as usual.");
}

absl::Status RunDaemon(const DaemonOptions& options, DaemonConfigs configs) {
  // With one heap per thread, each heap would keep as much memory as its largest answer took.
  mallopt(M_ARENA_MAX, 4);
  const Clock& clock = SystemClock();
  const ServerConfig& config = configs.server;
  Tracks& tracks = configs.tracks;
  ASSIGN_OR_RETURN(ServiceManager manager, ServiceManager::FromEnvironment());
  RETURN_IF_ERROR(RaiseDescriptorLimit(config));
  std::error_code unmade;  // what is not there can't be locked
  fs::create_directories(options.data_dir, unmade);
  ASSIGN_OR_RETURN(const DataLock lock, DataLock::Take(options.data_dir));
  RETURN_IF_ERROR(MakeFolders(options.data_dir));
  StartLog(config.log_level, config.log_format);
  CheckSandboxes(config);
  ControlGroup::RemoveStale();
  Empty(options.data_dir + "/work");
  Empty(options.data_dir + "/spool");
  RemoveDrafts(options.data_dir + "/logs");

  const std::string path = options.data_dir + "/store.db";
  WarnOfLostStore(options.data_dir, path);
  ASSIGN_OR_RETURN(std::unique_ptr<Store> store, Store::Open(path, clock));
  if (const auto& migration = store->migration()) {
    spdlog::info("the store had schema {} and now has {}; {} keeps it as it was", migration->from,
                 migration->to, migration->copy);
  }
  if (store->mended()) spdlog::error("{}", DamageText(*store->mended()));
  RETURN_IF_ERROR(SetWebhooks(configs.webhooks, *store));
  const auto metrics = std::make_shared<Metrics>();
  ReaderPool readers(path);
  readers.SetObserver([&](absl::Duration took) { metrics->ObserveStoreRead(took); });
  readers.SetCorruptObserver(
      [&](const absl::Status& status) { store->Distrust(std::string(status.message())); });
  ASSIGN_OR_RETURN(Phases phases, MakePhases(configs, *store));
  RETURN_IF_ERROR(TakeConfigsInForce(*store, readers, tracks, phases));
  RETURN_IF_ERROR(LogPhases(phases, readers, clock.Now()));
  ASSIGN_OR_RETURN(const std::vector<Damage> damaged, FillStandings(*store, readers));
  for (const Damage& damage : damaged) spdlog::error("{}", DamageText(damage));
  StoreDisk disk(*store, metrics.get());
  ASSIGN_OR_RETURN(const HomeFound home,
                   FindHome(options.data_dir, config.on_cluster, /*adopt=*/false));
  ASSIGN_OR_RETURN(const LeaseHosts hosts,
                   MakeLeaseHosts(options, config, store->policy_secret(), home));
  Engine engine({config, options.data_dir, options.cache_dir, metrics}, disk, readers,
                *hosts.executor, clock);
  // Grading needs no key: without one, the daemon serves everything but receipts.
  KeyFile receipts_key(options.data_dir + "/receipts.key");
  if (absl::Status status = receipts_key.Get().status(); !status.ok()) {
    spdlog::error("no receipt can be signed: {}", std::string(status.message()));
  }
  RecordLog record;
  RETURN_IF_ERROR(StartRecord(*store, readers, receipts_key, record));
  const SignalGuard signals(engine);
  RETURN_IF_ERROR(engine.Recover());

  const ReferenceCheck reference(
      {.folder = options.configs_dir + "/reference",
       .work_dir = options.data_dir + "/work/reference",
       .cache_dir = options.cache_dir,
       .uid = geteuid() == 0 ? config.uid_base + kReferenceUsers : -1});
  for (const auto& [name, entry] : tracks.entries()) {
    const std::string why = WhyUnreferenced(
        options.configs_dir + "/reference", entry.profiles.at(entry.default_profile)->config.kind->name);
    if (!why.empty()) spdlog::warn("the track {} is for practice only: {}", name, why);
  }
  Admission admission({.config = config,
                       .data_dir = options.data_dir,
                       .cache_dir = options.cache_dir,
                       .reference =
                           [&](std::string_view kind, absl::Duration timeout) {
                             return reference.Result(kind, timeout);
                           }},
                      tracks, phases, engine, readers, clock);
  AccessLog access_log(
      [&](AccessLog::Change change) {
        return engine.Change(std::move(change), config.http.request);
      },
      clock, metrics.get());
  WebhookSender webhooks({.webhooks = configs.webhooks,
                          .readers = readers,
                          .write =
                              [&](WebhookSender::Change change) {
                                return engine.Change(std::move(change), config.http.request);
                              },
                          .metrics = *metrics,
                          .clock = clock});
  const MakerOptions makers = {.work_dir = options.data_dir + "/work/pictures",
                               .cache_dir = options.cache_dir,
                               .uid = geteuid() == 0 ? config.uid_base + kPictureUsers : -1};
  EndedEvaluations ended(readers);
  Pictures pictures({.folder = options.data_dir + "/pictures",
                     .build = [&] { return PictureBuild(options.cache_dir); },
                     .most_bytes = config.retention.picture_bytes,
                     .make =
                         [&](const PictureKey& key, const Stopped& stopped) {
                           return MakeFile(readers, options.data_dir, makers, key, stopped);
                         },
                     .grading =
                         [&] {
                           const LiveHealth health = engine.Health();
                           return health.running > 0 || health.pending > 0;
                         },
                     .quiet = config.pictures_ahead,
                     .suggestions = [&] { return ended.Pictures(); }});
  ASSIGN_OR_RETURN(const Documents documents, LoadDocuments(DocsDir()));
  Api api({.config = config,
           .data_dir = options.data_dir,
           .cache_dir = options.cache_dir,
           .tracks_dir = options.configs_dir + "/tracks",
           .tracks = tracks,
           .phases = phases,
           .admission = admission,
           .engine = engine,
           .readers = readers,
           .receipts_key = receipts_key,
           .access_log = access_log,
           .record = record,
           .pictures = pictures,
           .metrics = *metrics,
           .webhooks = webhooks,
           .documents = documents,
           .metrics_token = configs.metrics_token,
           .leases = hosts.door,
           .challenge = phases.any(),
           .clock = clock,
           .started_at = clock.Now(),
           .began = clock.Monotonic()});
  UnixHttpServer server(config.http, options.data_dir + "/spool");
  api.Install(server);
  Fd network_socket = manager.TakeNetworkSocket();
  WarnOfFilteredPackets(configs, network_socket.valid());
  if (config.listen.has_value()) {
    RETURN_IF_ERROR(server.OpenNetwork(*config.listen, std::move(network_socket)));
  } else if (network_socket.valid()) {
    return absl::InvalidArgumentError(
        "the service manager listens on a TCP port, but server.json has no \"listen\" with the "
        "certificate for it; add that (myograde-server.json(5)), or disable the socket unit");
  }
  // Before the socket answers, so that whoever waits for that finds the URL.
  const NetworkGuard network(options.data_dir + "/listen", server.NetworkUrl());
  if (Fd socket = manager.TakeSocket(); socket.valid()) {
    server.StartOn(std::move(socket));
  } else if (absl::Status status = server.Start(options.socket); !status.ok()) {
    return status;
  }
  server_to_stop = &server;
  access_log.Start();
  webhooks.Start();
  std::optional<absl::Time> trusted;
  if (const auto ms = store->trusted_time_ms()) trusted = absl::FromUnixMillis(*ms);
  const Retention retention(config.retention, config.artefacts.disk_reserve, options.data_dir, engine,
                            readers, clock, trusted);
  const Rejudger rejudger({.data_dir = options.data_dir,
                           .grader = [&] {
                             return WithRuntimes(
                                 GraderBuild(options.cache_dir, AdapterNames()),
                                 RuntimeDigests(Runtimes(config.runtimes, config.runtimes_dir)));
                           }},
                          engine, readers);
  spdlog::info("listening on {}, {} slots, {} tracks, {} phases", options.socket,
               config.scheduler.slots, tracks.entries().size(), phases.entries().size());
  if (config.listen.has_value()) spdlog::info("listening on {}", server.NetworkUrl());
  manager.Tell("READY=1");
  engine.SetHeartbeat(std::min(manager.watchdog() / kBeatsPerWatchdog, kTrimEvery),
                      [&, trimmed = clock.Monotonic()]() mutable {
                        if (manager.watchdog() < absl::InfiniteDuration()) {
                          manager.Tell("WATCHDOG=1");
                        }
                        if (clock.Monotonic() - trimmed < kTrimEvery) return;
                        malloc_trim(0);
                        trimmed = clock.Monotonic();
                      });
  const absl::Status status = engine.Run();
  manager.Tell("STOPPING=1");
  EndSoon(status.ok() ? 0 : 4, config.on_cluster ? kLeaveClusterWithin : kLeaveWithin);
  server_to_stop = nullptr;
  pictures.Stop();
  webhooks.Stop();
  server.Shutdown();
  access_log.Stop();
  // The engine, the store's only writer until now, has ended.
  const absl::Status recorded = access_log.WriteAll(
      [&](AccessLog::Change change) { return store->Write(change); });
  if (!recorded.ok()) {
    spdlog::error("the last denied requests and acts are not recorded: {}",
                  std::string(recorded.message()));
  }
  spdlog::info("stopped");
  return status;
}

}  // namespace myograde::server
