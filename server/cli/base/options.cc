#include "server/cli/base/options.h"

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include <algorithm>
#include <filesystem>

#include "server/base/paths.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

// Of the daemon that a package's units start.
constexpr char kSystemSocket[] = "/run/myograde/myograde.sock";

}  // namespace

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

bool IsSimpleName(const std::string& text, size_t most, bool any_first) {
  const auto plain = [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-';
  };
  return !text.empty() && text.size() <= most && std::all_of(text.begin(), text.end(), plain) &&
         (any_first || absl::ascii_isalnum(static_cast<unsigned char>(text.front())));
}

std::optional<std::pair<int64_t, int64_t>> ParseRange(const std::string& text) {
  const std::pair<std::string, std::string> ends = absl::StrSplit(text, absl::MaxSplits("..", 1));
  std::pair<int64_t, int64_t> range;
  if (!absl::SimpleAtoi(ends.first, &range.first) ||
      !absl::SimpleAtoi(ends.second, &range.second)) {
    return std::nullopt;
  }
  return range;
}

absl::Status RefuseIf(std::initializer_list<std::pair<bool, std::string>> mistakes) {
  for (const auto& [wrong, sentence] : mistakes) {
    if (wrong) return absl::InvalidArgumentError(sentence);
  }
  return absl::OkStatus();
}

void AddJson(CLI::App& verb, const std::string& schema, bool& json, const std::string& help) {
  verb.add_flag("--json", json, absl::StrCat(help, " (configs/schema/", schema, ".json)"));
}

void AddFullHashes(CLI::App& verb, bool& full) {
  verb.add_flag("--full-hashes", full,
                "All digits of hashes, not the first 12 (--json has them all)");
}

std::string DataDir(const std::string& option) {
  const std::string folder = option.empty() ? EnvironmentVariable("MYOGRADE_DATA") : option;
  return folder.empty() ? UsualDataDir() : folder;
}

std::string SocketPath(const std::string& socket_option, const std::string& data_option) {
  if (!socket_option.empty()) return socket_option;
  const std::string own = DataDir(data_option) + "/myograde.sock";
  const bool named = !data_option.empty() || !EnvironmentVariable("MYOGRADE_DATA").empty();
  std::error_code error;
  if (named || std::filesystem::exists(own, error)) return own;
  return std::filesystem::exists(kSystemSocket, error) ? kSystemSocket : own;
}

std::string HostOptions::configs_dir() const { return configs.empty() ? ConfigDir() : configs; }

std::string HostOptions::cache_dir() const {
  const std::string folder = cache.empty() ? EnvironmentVariable("MYOGRADE_CACHE") : cache;
  return folder.empty() ? UsualCacheDir() : std::filesystem::absolute(folder).string();
}

void AddHostOptions(CLI::App& verb, HostOptions& options) {
  verb.add_option("--configs", options.configs,
                  "Folder with tracks/ and server.json (default: MYOGRADE_CONFIG_DIR, else the "
                  "configs that MyoGrade came with)");
  verb.add_option("--cache", options.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "~/.cache/myograde if it has models, else /var/cache/myograde)");
}

void AddPolicyPath(CLI::App& verb, const std::string& name, std::string& path) {
  verb.add_option(name, path,
                  "An executable file, a folder with a policy.json, an archive of such a folder "
                  "(.tar, .tar.gz, .tar.zst, .zip), or a container image as podman save writes it")
      ->required();
}

}  // namespace myograde::server
