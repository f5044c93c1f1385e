#include "server/cli/common.h"

#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/config_reader.h"
#include "protocol/lease/track_config.h"
#include "server/cli/screen.h"
#include "server/cli/terminal.h"
#include "server/base/paths.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxSeedFileBytes = 1 << 20;

std::string Environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

absl::StatusOr<std::vector<uint64_t>> SeedsOfLines(const std::string& text,
                                                   const std::string& path) {
  std::vector<uint64_t> seeds;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    line = line.substr(0, line.find('#'));
    const size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos) continue;
    line = line.substr(begin, line.find_last_not_of(" \t\r") + 1 - begin);
    uint64_t seed = 0;
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), seed);
    if (error != std::errc() || end != line.data() + line.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": line ", number,
                       " is no seed; write one whole number from 0 to 2^63-1 on each line"));
    }
    seeds.push_back(seed);
  }
  return seeds;
}

}  // namespace

int ExitOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kDone;
    case absl::StatusCode::kUnavailable:
      return kUnreachable;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return kWrongUse;
    default:
      return kTrouble;
  }
}

int Complain(const absl::Status& status) {
  PrintToErrors(absl::StrCat("myograde: error: ", status.message()));
  return ExitOf(status);
}

absl::Status HostStatus(std::string_view what, const absl::Status& status) {
  if (status.ok()) return status;
  const int exit = ExitOf(status);
  const absl::StatusCode code =
      exit == kWrongUse ? status.code() : absl::StatusCode::kInternal;
  return absl::Status(code, absl::StrCat(absl::string_view(what.data(), what.size()),
                                         what.empty() ? "" : ": ", status.message()));
}

void PrintJson(const nlohmann::json& json) {
  PlainOutput() << json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
}

std::string DataDir(const std::string& option) {
  if (!option.empty()) return option;
  if (const std::string folder = Environment("MYOGRADE_DATA"); !folder.empty()) return folder;
  return UsualDataDir();
}

std::string CacheDir(const std::string& option) {
  if (!option.empty()) return std::filesystem::absolute(option).string();
  if (const std::string folder = Environment("MYOGRADE_CACHE"); !folder.empty()) {
    return std::filesystem::absolute(folder).string();
  }
  return UsualCacheDir();
}

std::string SocketPath(const std::string& socket_option, const std::string& data_option) {
  return socket_option.empty() ? DataDir(data_option) + "/myograde.sock" : socket_option;
}

void AddDaemonOptions(CLI::App& verb, ApiOptions& options) {
  verb.add_option("--data", options.data,
                  "Data folder of the daemon (default: MYOGRADE_DATA, else /var/lib/myograde for "
                  "root and ~/.local/share/myograde for others)");
  verb.add_option("--socket", options.socket, "The daemon's socket (default: DATA/myograde.sock)");
}

std::string HostOptions::configs_dir() const { return configs.empty() ? ConfigDir() : configs; }

CLI::Validator WholeNumber(int64_t least, const std::string& what) {
  return CLI::Validator(
      [least, what](const std::string& text) {
        int64_t number = 0;
        if (absl::SimpleAtoi(text, &number) && number >= least) return std::string();
        return absl::StrCat("\"", CutText(Harmless(text), 40), "\" is ", what,
                            ": write a whole number from ", least, " on");
      },
      "");
}

void AddSubmissionId(CLI::App& verb, int64_t& id, bool required, const std::string& help) {
  verb.add_option("ID", id, help)
      ->required(required)
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "no submission's number, as \"myograde status\" lists them"));
}

void AddFullHashes(CLI::App& verb, bool& full) {
  verb.add_flag("--full-hashes", full,
                "All digits of hashes, not the first 12 (--json has them all)");
}

void AddHostOptions(CLI::App& verb, HostOptions& options) {
  verb.add_option("--configs", options.configs,
                  "Folder with tracks/ and server.json (default: MYOGRADE_CONFIG_DIR, else the "
                  "configs that MyoGrade came with)");
  verb.add_option("--cache", options.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "/var/cache/myograde for root and ~/.cache/myograde for others)");
}

absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path) {
  const absl::StatusOr<std::string> read = ReadFile(path, kMaxSeedFileBytes);
  if (!read.ok()) return read.status();
  const std::string& text = *read;
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin != std::string::npos && (text[begin] == '[' || text[begin] == '{')) {
    const absl::StatusOr<nlohmann::json> json = ParseJson(text, path);
    if (!json.ok()) return json.status();
    return ParseSeeds(*json, path);
  }
  const absl::StatusOr<std::vector<uint64_t>> seeds = SeedsOfLines(text, path);
  if (!seeds.ok()) return seeds.status();
  return ParseSeeds(nlohmann::json(*seeds), path);
}

absl::StatusOr<TempFolder> TempFolder::Make(const std::string& purpose) {
  std::error_code error;
  const std::filesystem::path base = std::filesystem::temp_directory_path(error);
  std::string name = (base / absl::StrCat("myograde-", purpose, ".XXXXXX")).string();
  if (error || ::mkdtemp(name.data()) == nullptr) {
    return absl::InternalError(absl::StrCat(
        "can't make a temporary folder in ", base.string(), ": ",
        error ? error.message() : std::strerror(errno), "; set TMPDIR to a folder with space"));
  }
  return TempFolder(name);
}

TempFolder::~TempFolder() {
  if (path_.empty()) return;
  std::error_code ignored;  // nobody is left to tell
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace myograde::server
