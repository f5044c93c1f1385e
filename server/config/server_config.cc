#include "server/config/server_config.h"

#include <grp.h>
#include <pwd.h>

#include <filesystem>
#include <system_error>
#include <thread>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"
#include "server/base/names.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr int64_t kTiB = int64_t{1} << 40;
constexpr int64_t kMany = 1'000'000'000;

// Keys that may be left out.
template <typename Int>
Int IntegerOr(ConfigReader& reader, std::string_view key, Int fallback, int64_t min, int64_t max) {
  return reader.Has(key) ? static_cast<Int>(reader.Integer(key, min, max)) : fallback;
}

absl::Duration SecondsOr(ConfigReader& reader, std::string_view key, absl::Duration fallback,
                         NumberRange range) {
  return reader.Has(key) ? absl::Seconds(reader.Number(key, range)) : fallback;
}

nlohmann::json ObjectOr(ConfigReader& reader, std::string_view key) {
  return reader.Has(key) ? reader.Object(key) : nlohmann::json::object();
}

int ReadSlots(ConfigReader& reader, const nlohmann::json& json) {
  const bool cores = json.is_object() && json.contains("slots") && json["slots"].is_string();
  if (!cores) return static_cast<int>(reader.Integer("slots", 1, 1024));
  reader.Choice("slots", {"cores"});
  return static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 1024u));
}

absl::Status ReadRuntimes(const nlohmann::json& json, const std::string& where,
                          const std::string& cache_dir, ServerConfig& config) {
  for (const auto& [name, entry] : json.items()) {
    if (name.starts_with("//")) continue;
    ConfigReader reader(entry, absl::StrCat(where, ": ", name));
    const std::string path =
        absl::StrReplaceAll(reader.String("path"), {{"${cache}", cache_dir}});
    if (!path.starts_with('/')) reader.Fail("path", "must be absolute, or begin with ${cache}");
    RETURN_IF_ERROR(reader.Finish());
    config.runtimes[name] = path;
  }
  return absl::OkStatus();
}

absl::Status ReadScheduler(const nlohmann::json& json, const std::string& where,
                           ServerConfig& config) {
  ConfigReader reader(json, where);
  config.scheduler.max_retries = static_cast<int>(reader.Integer("max_retries", 1, 100));
  config.scheduler.retry_delay = absl::Seconds(reader.Number("retry_delay_s", {0.001, 3600}));
  config.scheduler.heartbeat = absl::Seconds(reader.Number("heartbeat_s", {2, 3600}));
  config.scheduler.team_running = static_cast<int>(reader.Integer("team_running", 1, 1024));
  config.scheduler.queue_wait = absl::Seconds(reader.Number("queue_wait_s", {1, 30.0 * 86400}));
  config.host.suspect_after = static_cast<int>(reader.Integer("suspect_after", 1, 100));
  config.self_test_deadline = absl::Seconds(reader.Number("self_test_s", {1, 3600}));
  config.host.test_every = absl::Seconds(reader.Number("self_test_every_s", {1, 86400}));
  config.lease_grace = absl::Seconds(reader.Number("lease_grace_s", {1, 86400}));
  return reader.Finish();
}

absl::Status ReadArtefacts(const nlohmann::json& json, const std::string& where,
                           ServerConfig& config) {
  ConfigReader reader(json, where);
  UploadLimits& limits = config.artefacts;
  limits.archive_bytes = reader.Integer("archive_bytes", 4096, kTiB);
  limits.bytes = reader.Integer("bytes", 4096, kTiB);
  limits.files = reader.Integer("files", 1, 10'000'000);
  limits.unpack_memory_bytes = reader.Integer("unpack_memory_bytes", int64_t{128} << 20, kTiB);
  limits.uploads = static_cast<int>(reader.Integer("uploads", 1, 1000));
  limits.unpack_cpu = SecondsOr(reader, "unpack_cpu_s", limits.unpack_cpu, {1, 86400});
  limits.disk_reserve = IntegerOr(reader, "disk_reserve_bytes", limits.disk_reserve, 1, kTiB);
  UnsubmittedLimits& unsubmitted = limits.unsubmitted;
  unsubmitted.count = IntegerOr(reader, "unsubmitted", unsubmitted.count, 1, kMany);
  unsubmitted.bytes = IntegerOr(reader, "unsubmitted_bytes", unsubmitted.bytes, 1, 1024 * kTiB);
  unsubmitted.of_one = IntegerOr(reader, "uploader_unsubmitted", unsubmitted.of_one, 1, kMany);
  unsubmitted.bytes_of_one =
      IntegerOr(reader, "uploader_unsubmitted_bytes", unsubmitted.bytes_of_one, 1, 1024 * kTiB);
  unsubmitted.age = SecondsOr(reader, "unsubmitted_s", unsubmitted.age, {1, 36500.0 * 86400});
  return reader.Finish();
}

// "" if it is null or left out.
std::string PathOrNull(ConfigReader& reader, const nlohmann::json& json, const char* key) {
  reader.Ignore(key);
  if (!reader.Has(key) || json[key].is_null()) return "";
  const std::string path = reader.String(key);
  if (!path.starts_with('/')) reader.Fail(key, "must be the absolute path of a file, or null");
  return path;
}

absl::Status ReadListen(const nlohmann::json& json, const std::string& where,
                        ServerConfig& config) {
  ConfigReader reader(json, where);
  ListenConfig listen;
  listen.address = reader.String("address");
  listen.port = static_cast<int>(reader.Integer("port", 0, 65535));
  if (!reader.mistake().ok()) return reader.mistake();
  listen.certificate = PathOrNull(reader, json, "certificate");
  listen.key = PathOrNull(reader, json, "key");
  listen.behind_proxy = reader.Has("behind_proxy") && reader.Boolean("behind_proxy");
  const std::optional<IpAddress> address = IpAddress::Parse(listen.address);
  if (!address.has_value()) {
    reader.Fail("address", "must be an IP address of this host, or 0.0.0.0 or :: for all of them");
  } else if (listen.certificate.empty() != listen.key.empty()) {
    reader.Fail(listen.key.empty() ? "key" : "certificate",
                "is missing: a certificate and its key go together");
  } else if (listen.certificate.empty() && !address->IsLoopback()) {
    reader.Fail("certificate",
                "is missing: without TLS the daemon listens only on a loopback address such as "
                "127.0.0.1");
  } else if (listen.behind_proxy && !address->IsLoopback()) {
    reader.Fail("behind_proxy",
                "is for a proxy on this host: it needs a loopback address such as 127.0.0.1, "
                "because other hosts could forge the header");
  }
  config.listen = std::move(listen);
  return reader.Finish();
}

absl::Status ReadHttp(const nlohmann::json& json, const std::string& where, ServerConfig& config) {
  ConfigReader reader(json, where);
  HttpLimits& limits = config.http;
  // At least two, so that an upload does not keep everybody else waiting.
  limits.workers = static_cast<int>(reader.Integer("workers", 2, 1000));
  limits.clients = static_cast<int>(reader.Integer("clients", 1, 100'000));
  limits.request = absl::Seconds(reader.Number("request_s", {0.1, 3600}));
  limits.upload = absl::Seconds(reader.Number("upload_s", {1, 86400}));
  limits.idle = absl::Seconds(reader.Number("idle_s", {1, 86400}));
  limits.body_bytes = reader.Integer("body_bytes", 1024, int64_t{1} << 30);
  const int64_t archive = config.artefacts.archive_bytes;
  const int half_workers = limits.workers / 2;
  const int half_clients = limits.clients / 2;
  limits.organiser_workers =
      IntegerOr(reader, "organiser_workers", std::min(4, half_workers), 1, half_workers);
  limits.organiser_clients = IntegerOr(reader, "organiser_clients", std::min(16, half_clients), 1,
                                       std::max(limits.clients - 1, 1));
  limits.peer_clients =
      IntegerOr(reader, "peer_clients", std::max(half_clients, 1), 1, limits.clients);
  limits.address_clients =
      IntegerOr(reader, "address_clients", std::min(32, limits.clients), 1, limits.clients);
  limits.min_bytes_per_s =
      IntegerOr(reader, "min_bytes_per_s", limits.min_bytes_per_s, 1, int64_t{1} << 30);
  limits.speed_window = SecondsOr(reader, "speed_window_s", limits.speed_window, {1, 86400});
  limits.spool_bytes = IntegerOr(reader, "spool_bytes", 8 * archive, archive, 1024 * kTiB);
  limits.peer_spool_bytes =
      IntegerOr(reader, "peer_spool_bytes", 4 * archive, archive, 1024 * kTiB);
  limits.disk_reserve = config.artefacts.disk_reserve;
  limits.large_uploads = config.artefacts.uploads;
  if (reader.Has("requests_per_s")) {
    limits.requests_per_s = reader.Number("requests_per_s", {0.01, 1e6});
  }
  if (reader.Has("burst")) limits.burst = reader.Number("burst", {1, 1e6});
  const std::string mode = reader.String("socket_mode");
  if (mode.size() != 4 || mode[0] != '0' ||
      mode.find_first_not_of("01234567") != std::string::npos) {
    reader.Fail("socket_mode", "must be four octal digits that begin with 0, as in \"0660\"");
  } else {
    limits.socket_mode = static_cast<unsigned>(std::stoul(mode, nullptr, 8));
  }
  reader.Ignore("listen");
  const bool listens = reader.Has("listen") && !json["listen"].is_null();
  RETURN_IF_ERROR(reader.Finish());
  return listens ? ReadListen(json["listen"], absl::StrCat(where, ": listen"), config)
                 : absl::OkStatus();
}

absl::StatusOr<UserRule> ReadUserRule(const nlohmann::json& json, const std::string& where) {
  constexpr int64_t kMostId = 4'294'967'294;  // the last of 32 bits stands for none
  ConfigReader reader(json, where);
  UserRule rule;
  int named = 0;
  for (const char* key : {"uid", "user", "gid", "group"}) named += reader.Has(key) ? 1 : 0;
  if (reader.Has("uid")) rule.uid = static_cast<uid_t>(reader.Integer("uid", 0, kMostId));
  if (reader.Has("gid")) rule.gid = static_cast<gid_t>(reader.Integer("gid", 0, kMostId));
  if (reader.Has("user")) rule.user = reader.String("user");
  if (reader.Has("group")) rule.group = reader.String("group");
  rule.role = ParseRole(reader.Choice("role", {"participant", "organiser", "operator"}))
                  .value_or(Role::kPublic);
  if (reader.Has("team")) rule.team = reader.String("team");
  const std::string who = !rule.user.empty() ? rule.user : rule.group;
  if (named != 1) {
    reader.Fail("uid", "or one of \"user\", \"gid\" and \"group\" must be given, and only one");
  } else if (!rule.uid && !rule.gid && !IsPlainText(who, kMaxNameBytes)) {
    reader.Fail(rule.user.empty() ? "group" : "user", "must be a name");
  } else if (rule.role != Role::kParticipant && !rule.team.empty()) {
    reader.Fail("team", "is only for participants; organisers act for every team");
  } else if (reader.Has("team") && !IsPlainText(rule.team, kMaxNameBytes)) {
    reader.Fail("team", absl::StrCat("must be 1 to ", kMaxNameBytes, " bytes of text"));
  }
  RETURN_IF_ERROR(reader.Finish());
  return rule;
}

absl::Status ReadAccess(const nlohmann::json& json, const std::string& where,
                        ServerConfig& config) {
  ConfigReader reader(json, where);
  AccessConfig& access = config.access;
  access.teams_of_a_user =
      IntegerOr(reader, "teams_of_a_user", access.teams_of_a_user, 1, kMany);
  const nlohmann::json users =
      reader.Has("users") ? reader.Array("users") : nlohmann::json::array();
  RETURN_IF_ERROR(reader.Finish());
  for (size_t i = 0; i < users.size(); ++i) {
    ASSIGN_OR_RETURN(UserRule rule,
                     ReadUserRule(users[i], absl::StrCat(where, ": users[", i, "]")));
    access.users.push_back(std::move(rule));
  }
  return absl::OkStatus();
}

absl::Status ReadReruns(const nlohmann::json& json, const std::string& where,
                        ServerConfig& config) {
  ConfigReader reader(json, where);
  RerunLimits& limits = config.reruns;
  limits.unfinished = IntegerOr(reader, "unfinished", limits.unfinished, 1, kMany);
  limits.of_one = IntegerOr(reader, "of_one", limits.of_one, 1, kMany);
  limits.of_a_submission = IntegerOr(reader, "of_a_submission", limits.of_a_submission, 1, kMany);
  limits.of_organisers = IntegerOr(reader, "of_organisers", limits.of_organisers, 1, kMany);
  return reader.Finish();
}

absl::Status ReadRetention(const nlohmann::json& json, const std::string& where,
                           ServerConfig& config) {
  constexpr double kCentury = 36500;
  ConfigReader reader(json, where);
  RetentionLimits& limits = config.retention;
  limits.artefact_age = absl::Hours(24 * reader.Number("artefact_days", {1, kCentury}));
  limits.artefact_bytes = reader.Integer("artefact_bytes", 1, 1024 * kTiB);
  limits.log_age = absl::Hours(24 * reader.Number("log_days", {1, kCentury}));
  limits.log_bytes = reader.Integer("log_bytes", 1, 1024 * kTiB);
  limits.picture_bytes =
      IntegerOr(reader, "picture_bytes", limits.picture_bytes, int64_t{16} << 20, 1024 * kTiB);
  limits.every = absl::Seconds(reader.Number("every_s", {1, 86400}));
  limits.upload_age = config.artefacts.unsubmitted.age;
  return reader.Finish();
}

absl::Status ReadMetrics(const nlohmann::json& json, const std::string& where,
                         ServerConfig& config) {
  ConfigReader reader(json, where);
  config.metrics_token_file = PathOrNull(reader, json, "token_file");
  return reader.Finish();
}

absl::StatusOr<AdmissionRules> ReadAdmission(ConfigReader& reader) {
  AdmissionRules rules;
  rules.quota.ranked.per_day = reader.Integer("official_per_day", 1, kMany);
  rules.quota.ranked.total = reader.Integer("official_total", 1, kMany);
  rules.quota.practice.per_day = reader.Integer("practice_per_day", 1, kMany);
  rules.quota.practice.total = reader.Integer("practice_total", 1, kMany);
  rules.quota.failed.per_day = reader.Integer("failed_per_day", 1, kMany);
  rules.quota.failed.total = reader.Integer("failed_total", 1, kMany);
  rules.quota.waiting = reader.Integer("waiting", 1, kMany);
  rules.one_for_everyone = reader.Choice("same_artefact", {"team", "everyone"}) == "everyone";
  RETURN_IF_ERROR(reader.Finish());
  return rules;
}

// A track's own keys override the defaults.
absl::Status ReadQuota(const nlohmann::json& json, const std::string& where,
                       ServerConfig& config) {
  ConfigReader reader(json, where);
  const nlohmann::json tracks = reader.Object("tracks");
  ASSIGN_OR_RETURN(config.quota.defaults, ReadAdmission(reader));
  for (const auto& [name, own] : tracks.items()) {
    if (name.starts_with("//")) continue;
    const std::string place = absl::StrCat(where, ": tracks: ", name);
    if (!own.is_object()) {
      return absl::InvalidArgumentError(absl::StrCat(place, ": must be an object"));
    }
    nlohmann::json merged = json;
    merged.erase("tracks");
    merged.update(own);  // not a merge patch: null must not remove a limit
    ConfigReader track(merged, place);
    ASSIGN_OR_RETURN(AdmissionRules rules, ReadAdmission(track));
    config.quota.tracks[name] = rules;
  }
  return absl::OkStatus();
}

// The object is read, and its mistakes found, wherever leases run.
absl::Status ReadExecutor(const nlohmann::json& json, const std::string& where,
                          ServerConfig& config) {
  ASSIGN_OR_RETURN(config.slurm, ReadSlurm(json, where));
  if (!config.on_cluster) return absl::OkStatus();
  config.scheduler.slots = config.slurm.most_jobs;
  config.scheduler.begins_later = true;
  return absl::OkStatus();
}

}  // namespace

bool PinsSlots(const ServerConfig& config, int slots, const TrackConfig& track) {
  return config.pin_slots && !config.on_cluster && track.budgets.cpus <= 1 &&
         static_cast<unsigned>(slots) >= std::thread::hardware_concurrency();
}

int64_t DescriptorsNeeded(const ServerConfig& config) {
  // Logs, the store, the lock, the listener, and a reserve.
  constexpr int64_t kBase = 128;
  // A runner's three pipes; six more descriptors while it is being started.
  constexpr int64_t kOfASlot = 4;
  // A connection and its spooled body.
  constexpr int64_t kOfAClient = 2;
  // A store connection with its write-ahead log, an open file, a pipe to the unpack process.
  constexpr int64_t kOfAWorker = 8;
  return kBase + kOfASlot * config.scheduler.slots + kOfAClient * config.http.clients +
         config.http.waiting() + kOfAWorker * config.http.workers;
}

absl::StatusOr<ServerConfig> LoadServerConfig(const std::string& path,
                                              const std::string& cache_dir) {
  absl::StatusOr<nlohmann::json> json = ReadJsonFile(path);
  if (!json.ok()) {
    const absl::StatusOr<std::string> bin_dir = BinDir();
    std::error_code error;
    if (std::filesystem::exists(path, error) ||
        (bin_dir.ok() && std::filesystem::exists(*bin_dir + "/myograde-runner", error))) {
      return json.status();
    }
    // Where only the client is installed, nobody misses a file.
    return absl::InternalError(
        "can't play episodes on this host: the programs for it are missing; install them (Debian: "
        "the package myograde-server), or set MYOGRADE_BIN_DIR to their folder");
  }
  ConfigReader reader(*json, path);
  ServerConfig config;
  config.scheduler.slots = ReadSlots(reader, *json);
  config.uid_base = reader.Integer("uid_base", 1000, 2'000'000'000);
  config.pin_slots = reader.Boolean("pin_slots");
  config.on_cluster =
      reader.Has("executor") && reader.Choice("executor", {"local", "slurm"}) == "slurm";
  config.log_level = reader.Choice("log_level", {"debug", "info", "warn", "error"});
  if (reader.Has("log_format") && reader.Choice("log_format", {"text", "json"}) == "json") {
    config.log_format = LogFormat::kJson;
  }
  config.pictures_ahead =
      SecondsOr(reader, "pictures_ahead_s", config.pictures_ahead, {0, 30 * 86400.0});
  if (config.pictures_ahead == absl::ZeroDuration()) {
    config.pictures_ahead = absl::InfiniteDuration();
  }
  if (reader.Has("public_replay")) config.public_replay = reader.Boolean("public_replay");
  config.runtimes_dir = absl::StrReplaceAll(
      reader.Has("runtimes_dir") ? reader.String("runtimes_dir") : "${cache}/runtimes",
      {{"${cache}", cache_dir}});
  if (!config.runtimes_dir.starts_with('/')) {
    reader.Fail("runtimes_dir", "must be absolute, or begin with ${cache}");
  }
  const nlohmann::json& runtimes = reader.Object("runtimes");
  const nlohmann::json& scheduler = reader.Object("scheduler");
  const nlohmann::json slurm = ObjectOr(reader, "slurm");
  const nlohmann::json& artefacts = reader.Object("artefacts");
  const nlohmann::json& http = reader.Object("http");
  const nlohmann::json& quota = reader.Object("quota");
  const nlohmann::json& retention = reader.Object("retention");
  const nlohmann::json reruns = ObjectOr(reader, "reruns");
  const nlohmann::json statistics = ObjectOr(reader, "statistics");
  const nlohmann::json access = ObjectOr(reader, "access");
  const nlohmann::json metrics = ObjectOr(reader, "metrics");
  const nlohmann::json webhooks =
      reader.Has("webhooks") ? reader.Array("webhooks") : nlohmann::json::array();
  RETURN_IF_ERROR(reader.Finish());
  RETURN_IF_ERROR(ReadAccess(access, path + ": access", config));
  RETURN_IF_ERROR(ReadRuntimes(runtimes, path + ": runtimes", cache_dir, config));
  RETURN_IF_ERROR(ReadScheduler(scheduler, path + ": scheduler", config));
  RETURN_IF_ERROR(ReadExecutor(slurm, path + ": slurm", config));
  RETURN_IF_ERROR(ReadArtefacts(artefacts, path + ": artefacts", config));
  RETURN_IF_ERROR(ReadHttp(http, path + ": http", config));
  RETURN_IF_ERROR(ReadQuota(quota, path + ": quota", config));
  RETURN_IF_ERROR(ReadReruns(reruns, path + ": reruns", config));
  RETURN_IF_ERROR(ReadRetention(retention, path + ": retention", config));
  ASSIGN_OR_RETURN(config.statistics,
                   scoring::ParseStatistics(statistics, path + ": statistics", config.statistics));
  RETURN_IF_ERROR(ReadMetrics(metrics, path + ": metrics", config));
  ASSIGN_OR_RETURN(config.webhooks, ReadWebhooks(webhooks, path + ": webhooks"));
  return config;
}

absl::Status ResolveNames(const std::string& where, AccessConfig& access) {
  for (size_t i = 0; i < access.users.size(); ++i) {
    UserRule& rule = access.users[i];
    const std::string place = absl::StrCat(where, ": access: users[", i, "]: ");
    if (!rule.user.empty()) {
      const passwd* user = ::getpwnam(rule.user.c_str());
      if (user == nullptr) {
        return absl::InvalidArgumentError(absl::StrCat(place, "this host has no user \"", rule.user,
                                                       "\"; correct the name, or give a uid"));
      }
      rule.uid = user->pw_uid;
    } else if (!rule.group.empty()) {
      const group* members = ::getgrnam(rule.group.c_str());
      if (members == nullptr) {
        return absl::InvalidArgumentError(absl::StrCat(
            place, "this host has no group \"", rule.group, "\"; correct the name, or give a gid"));
      }
      rule.gid = members->gr_gid;
    }
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
