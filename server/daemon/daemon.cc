#include "server/daemon/daemon.h"

#include <malloc.h>
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
#include "server/base/paths.h"
#include "server/base/service_manager.h"
#include "server/engine/engine.h"
#include "server/engine/rejudges.h"
#include "server/engine/retention.h"
#include "server/engine/stored.h"
#include "server/metrics/metrics.h"
#include "server/pictures/picture_source.h"
#include "server/pictures/pictures.h"
#include "server/proof/reference_check.h"
#include "server/sandbox/slot_processes.h"
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

std::atomic<Engine*> engine_to_stop = nullptr;
std::atomic<HttpServer*> server_to_stop = nullptr;

void OnReload(int) {
  const int error = errno;
  if (HttpServer* server = server_to_stop.load()) server->ReloadCertificate();
  errno = error;
}

void OnSignal(int) {
  const int error = errno;
  if (Engine* engine = engine_to_stop.load()) engine->Stop();
  if (HttpServer* server = server_to_stop.load()) server->BeginStop();
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
    spdlog::warn("stopped without waiting for blocked threads");
    std::_Exit(exit_status);
  }).detach();
}

// A daemon's parts in the order in which they are made: what is made last goes first.
class Daemon {
 public:
  Daemon(const DaemonOptions& options, DaemonConfigs configs)
      : options_(options), configs_(std::move(configs)) {}

  // One after the other. An error says why the daemon can't start.
  absl::Status TakeFolder();
  absl::Status OpenStore();
  absl::Status RecoverEngine();
  absl::Status AddServices();
  absl::Status Listen();
  // Until a signal; how the engine ended.
  absl::Status Run();

 private:
  void StartPictures();
  ApiContext Context();
  // Tells the service manager that the daemon is alive, and gives free memory back.
  void StartHeartbeat();
  void Stop(const absl::Status& status);

  const DaemonOptions options_;
  DaemonConfigs configs_;
  const ServerConfig& config_ = configs_.server;
  const Clock& clock_ = SystemClock();
  const std::string store_path_ = options_.data_dir + "/store.db";
  std::optional<ServiceManager> manager_;
  std::optional<DataLock> lock_;
  std::unique_ptr<Store> store_;
  const std::shared_ptr<Metrics> metrics_ = std::make_shared<Metrics>();
  ReaderPool readers_{store_path_};
  std::optional<Phases> phases_;
  std::optional<SqliteStoreWriter> disk_;
  std::unique_ptr<Executor> executor_;
  std::optional<Engine> engine_;
  KeyFile receipts_key_{options_.data_dir + "/receipts.key"};
  RecordLog record_;
  std::optional<SignalGuard> signals_;
  std::optional<ReferenceCheck> reference_;
  std::optional<Admission> admission_;
  std::optional<AccessLog> access_log_;
  std::optional<WebhookSender> webhooks_;
  std::optional<Pictures> pictures_;
  std::optional<Documents> documents_;
  std::optional<Api> api_;
  std::optional<HttpServer> server_;
  std::optional<NetworkGuard> network_;
  std::optional<Retention> retention_;
  std::optional<Rejudger> rejudger_;
};

absl::Status Daemon::TakeFolder() {
  ASSIGN_OR_RETURN(manager_, ServiceManager::FromEnvironment());
  RETURN_IF_ERROR(RaiseDescriptorLimit(config_));
  std::error_code unmade;  // what is not there can't be locked
  fs::create_directories(options_.data_dir, unmade);
  ASSIGN_OR_RETURN(lock_, DataLock::Take(options_.data_dir));
  return PrepareFolder(options_.data_dir, config_);
}

absl::Status Daemon::OpenStore() {
  WarnOfLostStore(options_.data_dir, store_path_);
  ASSIGN_OR_RETURN(store_, Store::Open(store_path_, clock_));
  RETURN_IF_ERROR(SetWebhooks(configs_.webhooks, *store_));
  readers_.SetObserver([this](absl::Duration took, const absl::Status& read) {
    metrics_->ObserveStoreRead(took);
    if (IsCorruptStore(read)) store_->Distrust(std::string(read.message()));
  });
  ASSIGN_OR_RETURN(phases_, TakePhases(configs_, *store_, readers_, clock_.Now()));
  ASSIGN_OR_RETURN(const std::vector<Damage> damaged, FillStandings(*store_, readers_));
  for (const Damage& damage : damaged) spdlog::error("{}", DamageText(damage));
  return absl::OkStatus();
}

absl::Status Daemon::RecoverEngine() {
  disk_.emplace(*store_, metrics_.get());
  ASSIGN_OR_RETURN(const HomeFound home,
                   FindHome(options_.data_dir, *store_, config_.on_cluster, /*adopt=*/false));
  ASSIGN_OR_RETURN(executor_, MakeExecutor(options_, config_, home));
  engine_.emplace(EngineOptions{config_, options_.data_dir, options_.cache_dir, metrics_}, *disk_, readers_,
                  *executor_, clock_);
  // Grading needs no key: without one, the daemon serves everything but receipts.
  if (absl::Status status = receipts_key_.Get().status(); !status.ok()) {
    spdlog::error("can't sign receipts: {}", std::string(status.message()));
  }
  RETURN_IF_ERROR(StartRecord(*store_, readers_, receipts_key_, record_));
  signals_.emplace(*engine_);
  return engine_->Recover();
}

absl::Status Daemon::AddServices() {
  reference_.emplace(
      options_.configs_dir + "/reference",
      ReferenceOptions{.work_dir = options_.data_dir + "/work/reference",
                       .cache_dir = options_.cache_dir,
                       .uid = geteuid() == 0 ? config_.uid_base + kReferenceUsers : -1});
  for (const auto& [name, entry] : configs_.tracks.entries()) {
    const TrackConfig& config = entry.profiles.at(entry.default_profile)->config;
    const std::string why = reference_->references().WhyLacking(config.kind->name);
    if (!why.empty()) spdlog::warn("track {} is only for practice: {}", name, why);
  }
  const auto reference = [this](std::string_view kind, absl::Duration timeout) {
    return reference_->Result(kind, timeout);
  };
  admission_.emplace(AdmissionOptions{.config = config_,
                                      .data_dir = options_.data_dir,
                                      .cache_dir = options_.cache_dir,
                                      .reference = reference},
                     configs_.tracks, *phases_, *engine_, readers_, clock_);
  const auto change = [this](std::function<absl::Status(Transaction&)> act) {
    return engine_->Change(std::move(act), config_.http.request);
  };
  access_log_.emplace(change, clock_, metrics_.get());
  webhooks_.emplace(WebhookSender::Options{.webhooks = configs_.webhooks,
                                           .readers = readers_,
                                           .write = change,
                                           .metrics = *metrics_,
                                           .clock = clock_});
  StartPictures();
  ASSIGN_OR_RETURN(documents_, LoadDocuments(DocsDir()));
  server_.emplace(config_.http, options_.data_dir + "/spool");
  api_.emplace(Context(), *server_);
  return absl::OkStatus();
}

void Daemon::StartPictures() {
  const MakerOptions makers = {.work_dir = options_.data_dir + "/work/pictures",
                               .cache_dir = options_.cache_dir,
                               .uid = geteuid() == 0 ? config_.uid_base + kPictureUsers : -1};
  const auto make = [this, makers](const PictureKey& key, const Stopped& stopped) {
    return MakeFile(readers_, options_.data_dir, makers, key, stopped);
  };
  const auto grading = [this] {
    const LiveHealth health = engine_->Health();
    return health.running > 0 || health.pending > 0;
  };
  pictures_.emplace(PicturesOptions{.folder = options_.data_dir + "/pictures",
                                    .build = [this] { return PictureBuild(options_.cache_dir); },
                                    .most_bytes = config_.retention.picture_bytes,
                                    .make = make,
                                    .grading = grading,
                                    .quiet = config_.pictures_ahead,
                                    .suggestions = PicturesOfEnded(readers_)});
}

ApiContext Daemon::Context() {
  return {.config = config_,
          .data_dir = options_.data_dir,
          .cache_dir = options_.cache_dir,
          .tracks_dir = options_.configs_dir + "/tracks",
          .tracks = configs_.tracks,
          .phases = *phases_,
          .admission = *admission_,
          .engine = *engine_,
          .readers = readers_,
          .receipts_key = receipts_key_,
          .access_log = *access_log_,
          .record = record_,
          .pictures = *pictures_,
          .metrics = *metrics_,
          .webhooks = *webhooks_,
          .documents = *documents_,
          .metrics_token = configs_.metrics_token,
          .challenge = phases_->any(),
          .clock = clock_,
          .started_at = clock_.Now(),
          .began = clock_.Monotonic()};
}

absl::Status Daemon::Listen() {
  Fd network_socket = manager_->TakeNetworkSocket();
  WarnOfFilteredPackets(configs_, network_socket.valid());
  if (config_.listen.has_value()) {
    RETURN_IF_ERROR(server_->OpenNetwork(*config_.listen, std::move(network_socket)));
  } else if (network_socket.valid()) {
    return absl::InvalidArgumentError(
        "the service manager listens on a TCP port, but server.json has no \"listen\" with the "
        "certificate for it; add that (myograde-server.json(5)), or disable the socket unit");
  }
  // Before the socket answers, so that whoever waits for that finds the URL.
  network_.emplace(options_.data_dir + "/listen", server_->NetworkUrl());
  if (Fd socket = manager_->TakeSocket(); socket.valid()) {
    server_->StartOn(std::move(socket));
  } else {
    RETURN_IF_ERROR(server_->Start(options_.socket));
  }
  server_to_stop = &*server_;
  return absl::OkStatus();
}

absl::Status Daemon::Run() {
  access_log_->Start();
  webhooks_->Start();
  std::optional<absl::Time> trusted;
  if (const auto ms = store_->trusted_time_ms()) trusted = absl::FromUnixMillis(*ms);
  retention_.emplace(config_.retention, config_.artefacts.disk_reserve, options_.data_dir, *engine_, readers_,
                     clock_, trusted);
  rejudger_.emplace(RejudgerOptions{.data_dir = options_.data_dir,
                                    .grader = [this] { return engine_->HostBuild(); }},
                    *engine_, readers_);
  spdlog::info("listening on {}, {} slots, {} tracks, {} phases", options_.socket,
               config_.scheduler.slots, configs_.tracks.entries().size(), phases_->entries().size());
  if (config_.listen.has_value()) spdlog::info("listening on {}", server_->NetworkUrl());
  manager_->Tell("READY=1");
  StartHeartbeat();
  const absl::Status status = engine_->Run();
  Stop(status);
  return status;
}

void Daemon::StartHeartbeat() {
  engine_->SetHeartbeat(std::min(manager_->watchdog() / kBeatsPerWatchdog, kTrimEvery),
                        [this, trimmed = clock_.Monotonic()]() mutable {
                          if (manager_->watchdog() < absl::InfiniteDuration()) {
                            manager_->Tell("WATCHDOG=1");
                          }
                          if (clock_.Monotonic() - trimmed < kTrimEvery) return;
                          malloc_trim(0);
                          trimmed = clock_.Monotonic();
                        });
}

void Daemon::Stop(const absl::Status& status) {
  manager_->Tell("STOPPING=1");
  EndSoon(status.ok() ? 0 : 4, config_.on_cluster ? kLeaveClusterWithin : kLeaveWithin);
  server_to_stop = nullptr;
  pictures_->Stop();
  webhooks_->Stop();
  server_->Shutdown();
  access_log_->Stop();
  // The engine, the store's only writer until now, has ended.
  const absl::Status recorded = access_log_->WriteAll(
      [this](AccessLog::Change change) { return store_->Write(change); });
  if (!recorded.ok()) {
    spdlog::error("the latest denied requests and acts are not recorded: {}",
                  std::string(recorded.message()));
  }
  spdlog::info("stopped");
}

}  // namespace

absl::StatusOr<std::string> AdoptData(const std::string& data_dir) {
  const std::string path = data_dir + "/store.db";
  if (access(path.c_str(), F_OK) != 0) {
    return absl::NotFoundError(
        absl::StrCat(path, ": there is no store; name a daemon's data folder with --data"));
  }
  ASSIGN_OR_RETURN(const DataLock lock, DataLock::Take(data_dir));
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store, Store::Open(path, SystemClock()));
  ASSIGN_OR_RETURN(const HomeFound found,
                   FindHome(data_dir, *store, /*on_cluster=*/true, /*adopt=*/true));
  return absl::StrCat("The store is at home in ", found.home.place,
                      " now; start the daemon as usual.");
}

absl::Status RunDaemon(const DaemonOptions& options, DaemonConfigs configs) {
  // With one heap per thread, each heap would keep as much memory as its largest answer took.
  mallopt(M_ARENA_MAX, 4);
  Daemon daemon(options, std::move(configs));
  RETURN_IF_ERROR(daemon.TakeFolder());
  RETURN_IF_ERROR(daemon.OpenStore());
  RETURN_IF_ERROR(daemon.RecoverEngine());
  RETURN_IF_ERROR(daemon.AddServices());
  RETURN_IF_ERROR(daemon.Listen());
  return daemon.Run();
}

}  // namespace myograde::server
