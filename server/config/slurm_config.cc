#include "server/config/slurm_config.h"

#include <algorithm>
#include <cstdlib>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr size_t kMostOptions = 64;
constexpr size_t kMaxWord = 4096;
// What the daemon says to sbatch itself; said twice, its bookkeeping would be of other jobs.
constexpr const char* kOwnOptions[] = {"--array", "-a", "--job-name", "-J", "--comment", "--requeue",
                                       "--parsable", "--wait", "-W", "--wrap", "--test-only"};

// Printable ASCII without what would end a word of a script or a line.
bool IsWord(const std::string& text) {
  return text.size() <= kMaxWord && std::all_of(text.begin(), text.end(), [](char c) {
           return c > ' ' && c <= '~' && c != '\'' && c != '"' && c != '\\' && c != '`' && c != '$';
         });
}

std::string WordOr(ConfigReader& reader, const char* key) {
  if (!reader.Has(key)) return "";
  std::string word = reader.String(key);
  if (!IsWord(word)) reader.Fail(key, "must be printable ASCII without spaces, quotes, \"\\\" and \"$\"");
  return word;
}

std::string PathOr(ConfigReader& reader, const char* key) {
  std::string path = WordOr(reader, key);
  if (!path.empty() && !path.starts_with('/')) reader.Fail(key, "must be an absolute path, or \"\"");
  return path;
}

int IntegerOr(ConfigReader& reader, const char* key, int usual, int64_t min, int64_t max) {
  return reader.Has(key) ? static_cast<int>(reader.Integer(key, min, max)) : usual;
}

absl::Duration SecondsOr(ConfigReader& reader, const char* key, absl::Duration usual,
                         NumberRange range) {
  return reader.Has(key) ? absl::Seconds(reader.Number(key, range)) : usual;
}

bool IsOwn(const std::string& option) {
  return std::any_of(std::begin(kOwnOptions), std::end(kOwnOptions), [&](const std::string& own) {
    return option == own || option.starts_with(own + "=");
  });
}

void ReadOptions(ConfigReader& reader, SlurmConfig& config) {
  if (!reader.Has("extra_options")) return;
  config.extra_options = reader.Strings("extra_options");
  if (config.extra_options.size() > kMostOptions) {
    return reader.Fail("extra_options", absl::StrCat("has more than ", kMostOptions, " words"));
  }
  for (const std::string& option : config.extra_options) {
    if (!option.starts_with('-') || !IsWord(option)) {
      reader.Fail("extra_options", absl::StrCat("has \"", option, "\": each must be an option of "
                                                "sbatch in one word, such as \"--nice=100\""));
    } else if (IsOwn(option)) {
      reader.Fail("extra_options", absl::StrCat("has \"", option, "\", which the daemon sets itself"));
    }
  }
}

void ReadPlaces(ConfigReader& reader, SlurmConfig& config) {
  config.shared_dir = PathOr(reader, "shared_dir");
  config.url = WordOr(reader, "url");
  if (!config.url.empty() && !config.url.starts_with("https://")) {
    reader.Fail("url", "must begin with https://, as orders and tokens travel there, or be \"\"");
  }
  while (config.url.ends_with('/')) config.url.pop_back();
  config.ca_file = PathOr(reader, "ca_file");
  config.bin_dir = PathOr(reader, "bin_dir");
  config.cache_dir = PathOr(reader, "cache_dir");
  config.node_dir = PathOr(reader, "node_dir");
  config.slurm_bin_dir = PathOr(reader, "slurm_bin_dir");
}

}  // namespace

absl::StatusOr<SlurmConfig> ReadSlurm(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  SlurmConfig config;
  config.partition = WordOr(reader, "partition");
  config.account = WordOr(reader, "account");
  config.qos = WordOr(reader, "qos");
  config.constraint = WordOr(reader, "constraint");
  config.reservation = WordOr(reader, "reservation");
  ReadOptions(reader, config);
  config.time_limit_min = IntegerOr(reader, "time_limit_min", config.time_limit_min, 0, 525'600);
  config.memory_mib = IntegerOr(reader, "memory_mib", 0, 0, int64_t{64} << 20);
  config.cpus = IntegerOr(reader, "cpus", config.cpus, 0, 1024);
  config.most_jobs = IntegerOr(reader, "most_jobs", config.most_jobs, 1, 20'000);
  config.array_size = IntegerOr(reader, "array_size", config.array_size, 1, 1000);
  ReadPlaces(reader, config);
  config.queue_wait = SecondsOr(reader, "queue_wait_s", config.queue_wait, {1, 30.0 * 86400});
  config.claim = SecondsOr(reader, "claim_s", config.claim, {1, 86400});
  config.poll = SecondsOr(reader, "poll_s", config.poll, {0.1, 3600});
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

absl::Status CheckSlurmIsUsable(const SlurmConfig& config, const std::string& where) {
  if (!config.shared_dir.empty() || !config.url.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(where, ": neither \"shared_dir\" nor \"url\" is given: nodes get their leases through "
                          "a folder that they share with the daemon, or by HTTPS from its address"));
}

std::vector<std::string> SlurmEnvironment() {
  std::vector<std::string> kept = {"LC_ALL=C.UTF-8"};  // their messages are read
  for (const char* name : {"PATH", "HOME", "USER", "LOGNAME", "TMPDIR", "LD_LIBRARY_PATH", "SLURM_CONF",
                           "SLURM_CONF_SERVER", "SLURM_JWT"}) {
    if (const char* value = std::getenv(name)) kept.push_back(absl::StrCat(name, "=", value));
  }
  return kept;
}

}  // namespace myograde::server
