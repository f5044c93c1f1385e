#include "server/daemon/daemon.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"
#include "server/base/log_line.h"
#include "server/base/paths.h"
#include "server/executor/slurm/slurm_executor.h"
#include "server/proof/grader_build.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/sandbox_config.h"
#include "server/sandbox/stage.h"
#include "server/webhook/sender.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kStoreIdDigits = 12;

// Work in progress of an earlier daemon that died is useless: all that the folder holds, or what
// has a name that begins so.
void RemoveWork(const std::string& folder, std::string_view prefix = "") {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (!entry.path().filename().string().starts_with(prefix)) continue;
    fs::remove_all(entry.path(), error);
    if (error) spdlog::warn("{}: can't be removed: {}", entry.path().string(), error.message());
  }
}

// The logger is synchronous, so this runs on the thread whose fields count.
class LineFormatter : public spdlog::formatter {
 public:
  explicit LineFormatter(LogFormat format) : format_(format) {}

  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) override {
    const spdlog::string_view_t level = spdlog::level::to_string_view(message.level);
    const std::string line =
        LogLine(format_, absl::FromChrono(message.time), {level.data(), level.size()},
                {message.payload.data(), message.payload.size()}, CurrentLogFields());
    to.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<LineFormatter>(format_);
  }

 private:
  const LogFormat format_;
};

void StartLog(const std::string& level, LogFormat format) {
  auto log = spdlog::stderr_logger_mt("myograded");
  log->set_formatter(std::make_unique<LineFormatter>(format));
  log->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(log));
}

// The data folder holds the secret and everybody's submissions.
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
          path, ": can't create it or set its permissions (", error.message(),
          "); choose another data folder with --data"));
    }
  }
  return absl::OkStatus();
}

// Makes room for the sandboxes' control groups, and logs what an ordinary user lacks for sandboxes.
void CheckSandboxes(const ServerConfig& config) {
  if (config.on_cluster) return;
  if (const absl::Status status = DivideDelegatedGroup(); !status.ok()) {
    spdlog::warn("{}", std::string(status.message()));
  }
  if (geteuid() == 0 || CanMakeUserNamespace()) return;
  spdlog::error(
      "the daemon's user (uid {}) can't create user namespaces on this host, so nothing can be "
      "graded: set "
      "user.max_user_namespaces, and kernel.unprivileged_userns_clone=1 where the kernel has it, with "
      "sysctl, or run the daemon as root",
      geteuid());
}

absl::StatusOr<Phases> MakePhases(const DaemonConfigs& configs, Store& store) {
  const auto secret_of = [&](const PhaseConfig& phase) {
    std::string secret;
    const absl::Status written = store.Write([&](Transaction& writer) -> absl::Status {
      ASSIGN_OR_RETURN(secret, writer.phases.EnsureSecret(phase.name, phase.challenge));
      return absl::OkStatus();
    });
    return written.ok() ? secret : absl::StatusOr<std::string>(written);
  };
  return Phases::Make(configs.challenges, configs.tracks, secret_of);
}

absl::Status TakeConfigsInForce(Store& store, ReaderPool& readers, Tracks& tracks,
                                Phases& phases) {
  ASSIGN_OR_RETURN(Overlaid overlaid, readers.Read<Overlaid>([&](const Transaction& reader) {
    return OverlayConfigs(reader, tracks, phases);
  }));
  for (const std::string& note : overlaid.notes) spdlog::info("{}", note);
  for (const std::string& warning : overlaid.warnings) spdlog::warn("{}", warning);
  for (const std::string& error : overlaid.errors) spdlog::error("{}", error);
  if (overlaid.changed.empty()) return absl::OkStatus();
  return store.Write([&](Transaction& writer) {
    for (const NewBoardConfig& change : overlaid.changed) {
      RETURN_IF_ERROR(writer.journal.SetBoardConfig(change, "daemon").status());
    }
    return absl::OkStatus();
  });
}

absl::Status LogPhases(const Phases& phases, ReaderPool& readers, absl::Time now) {
  for (const auto& [name, why] : phases.unusable()) {
    spdlog::error("phase \"{}\" accepts nothing: {}", name, std::string(why.message()));
  }
  return readers.Read([&](const Transaction& reader) {
    std::vector<ChallengeConfig> usable = phases.challenges();
    for (ChallengeConfig& challenge : usable) {
      std::erase_if(challenge.phases, [&](const PhaseConfig& phase) {
        return phases.unusable().contains(phase.name);
      });
    }
    const auto contradicted = CheckAgainstStore(usable, reader, now);
    for (const std::string& sentence : contradicted.value_or(std::vector<std::string>())) {
      spdlog::error("{}", sentence);
    }
    for (const PhaseUse& use : reader.phases.InUse()) {
      if (phases.ConfigOf(use.phase) != nullptr) continue;
      spdlog::info(
          "phase \"{}\" has {} submissions but no file: it is closed, and its board is shown in "
          "full",
          use.phase, use.submissions);
    }
    return absl::OkStatus();
  });
}

}  // namespace

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

absl::Status PrepareFolder(const std::string& data, const ServerConfig& config) {
  RETURN_IF_ERROR(MakeFolders(data));
  StartLog(config.log_level, config.log_format);
  CheckSandboxes(config);
  ControlGroup::RemoveStale();
  RemoveWork(data + "/work");
  RemoveWork(data + "/spool");
  RemoveWork(data + "/logs", ".draft-");  // finished logs have other names
  return absl::OkStatus();
}

void WarnOfLostStore(const std::string& data_dir, const std::string& path) {
  std::error_code error;
  const std::string artefacts = data_dir + "/artefacts";
  const bool there = fs::exists(path, error) && fs::file_size(path, error) > 0;
  if (there || fs::is_empty(artefacts, error)) return;
  spdlog::error("{} is missing or empty, so the daemon creates an empty store, although {} has "
                "files of submissions; if the store was lost, stop the daemon and restore it "
                "from a backup", path, artefacts);
}

absl::StatusOr<HomeFound> FindHome(const std::string& data, Store& store, bool on_cluster,
                                   bool adopt) {
  ASSIGN_OR_RETURN(DataHome here, ReadDataHome(data));
  HomeFound found = {std::move(here), ""};
  RETURN_IF_ERROR(store.Write([&](Transaction& writer) {
    const std::optional<DataHome> recorded = writer.Home();
    const bool copied = recorded.has_value() && recorded->key != found.home.key;
    if (copied && on_cluster && !adopt) {
      found.held_back = absl::StrCat(
          found.home.place, " is a copy of the data folder ", recorded->place,
          ", which may still be grading, so this daemon leaves all jobs alone; if it replaces that "
          "daemon, stop it, run \"myograde serve --data ", data,
          " --adopt\" once, and start it again");
      spdlog::error("{}", found.held_back);
      return absl::OkStatus();
    }
    if (copied && !adopt) {
      spdlog::warn("{} is a copy of the data folder {} and now a separate server",
                   found.home.place, recorded->place);
    }
    if (!recorded.has_value() || copied || recorded->place != found.home.place) {
      writer.SetHome(found.home);
    }
    return absl::OkStatus();
  }));
  return found;
}

absl::StatusOr<Phases> TakePhases(DaemonConfigs& configs, Store& store, ReaderPool& readers,
                                  absl::Time now) {
  ASSIGN_OR_RETURN(Phases phases, MakePhases(configs, store));
  RETURN_IF_ERROR(TakeConfigsInForce(store, readers, configs.tracks, phases));
  RETURN_IF_ERROR(LogPhases(phases, readers, now));
  return phases;
}

absl::Status SetWebhooks(const std::vector<Webhook>& webhooks, Store& store) {
  std::vector<WebhookConfig> configs;
  std::set<std::string> names;
  for (const Webhook& webhook : webhooks) {
    configs.push_back(webhook.config);
    names.insert(webhook.config.name);
  }
  store.SetWebhooks(std::move(configs));
  return store.Write([&](Transaction& writer) -> absl::Status {
    ASSIGN_OR_RETURN(const int64_t given_up, writer.deliveries.AbandonAllBut(names));
    if (given_up > 0) {
      spdlog::warn("gave up {} events whose webhooks are no longer in server.json", given_up);
    }
    return absl::OkStatus();
  });
}

void WarnOfFilteredPackets(const DaemonConfigs& configs, bool handed) {
  std::vector<std::string> wanted;
  const std::optional<ListenConfig>& listen = configs.server.listen;
  if (listen.has_value() && !handed) {
    const std::optional<IpAddress> address = IpAddress::Parse(listen->address);
    if (!address.has_value() || !address->IsLoopback()) wanted.push_back("listen");
  }
  for (const Webhook& webhook : configs.webhooks) {
    // Without TLS they are for this host only.
    if (webhook.config.url.starts_with("https:")) wanted.push_back("webhook " + webhook.config.name);
  }
  if (configs.server.on_cluster) wanted.push_back("executor");
  const std::optional<IpAddress> own = wanted.empty() ? std::nullopt : OwnAddress();
  if (!own.has_value() || !IsRefused(*own)) return;
  spdlog::warn(
      "this service can't reach other hosts (IPAddressDeny= of its unit), which {} of server.json "
      "need: enable myograded-https.socket for listen, and for the rest copy network.conf "
      "from /usr/share/myograde/systemd to /etc/systemd/system/myograded.service.d",
      absl::StrJoin(wanted, ", "));
}

absl::Status StartRecord(Store& store, ReaderPool& readers, KeyFile& receipts_key,
                         RecordLog& record) {
  ASSIGN_OR_RETURN(const int64_t entries, readers.Read<int64_t>([](const Transaction& reader) {
    return reader.journal.RecordSize();
  }));
  if (const auto key = receipts_key.Get(); entries > 0 && key.ok()) {
    RETURN_IF_ERROR(store.Write([pem = (*key)->PublicPem()](Transaction& writer) {
      return writer.journal.AppendKey(pem);
    }));
  }
  return readers.Read([&](const Transaction& reader) -> absl::Status {
    for (const Damage& damage : record.Damaged(reader)) spdlog::error("{}", DamageText(damage));
    return absl::OkStatus();
  });
}

absl::StatusOr<std::unique_ptr<Executor>> MakeExecutor(const DaemonOptions& options,
                                                       const ServerConfig& config,
                                                       const HomeFound& home) {
  const int64_t uid_base = geteuid() == 0 ? config.uid_base : -1;
  if (!config.on_cluster) {
    return std::make_unique<LocalExecutor>(SlotProcesses(uid_base, options.data_dir + "/slots"));
  }
  ASSIGN_OR_RETURN(const SandboxConfig sandbox, LoadSandboxConfig(options.configs_dir));
  ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
  return std::make_unique<SlurmExecutor>(SlurmOptions{
      .config = config.slurm,
      // Shown in the cluster's queue.
      .store_id = Sha256Hex("a store on a cluster\n" + home.home.key).substr(0, kStoreIdDigits),
      .held_back = home.held_back,
      .cache_dir = options.cache_dir,
      .configs_dir = options.configs_dir,
      .bin_dir = bin_dir,
      .uid_base = uid_base,
      .log_bytes = sandbox.sim.log_bytes,
      .grader = [cache = options.cache_dir](const std::vector<std::string>& adapters) {
        return GraderBuild(cache, adapters);
      }});
}

}  // namespace myograde::server
