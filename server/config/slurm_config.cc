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
// What the daemon says to srun itself, and what would take a lease's streams away from it and can't be
// undone by a later word.
constexpr const char* kOwnOptions[] = {"--job-name", "-J",    "--comment",    "--test-only", "--label",
                                       "-l",         "--pty", "--multi-prog", "--jobid",
                                       "--no-allocate", "-Z"};
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

int IntegerOr(ConfigReader& reader, const char* key, int fallback, int64_t min, int64_t max) {
  return reader.Has(key) ? static_cast<int>(reader.Integer(key, min, max)) : fallback;
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
                                                "srun in one word, such as \"--nice=100\""));
    } else if (IsOwn(option)) {
      reader.Fail("extra_options", absl::StrCat("has \"", option, "\", which the daemon sets itself"));
    }
  }
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
  config.bin_dir = PathOr(reader, "bin_dir");
  config.cache_dir = PathOr(reader, "cache_dir");
  config.node_dir = PathOr(reader, "node_dir");
  config.slurm_bin_dir = PathOr(reader, "slurm_bin_dir");
  if (reader.Has("queue_wait_s")) {
    config.queue_wait = absl::Seconds(reader.Number("queue_wait_s", {1, 30.0 * 86400}));
  }
  RETURN_IF_ERROR(reader.Finish());
  return config;
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
