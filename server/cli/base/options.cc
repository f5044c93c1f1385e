#include "server/cli/base/options.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "server/base/paths.h"
#include "server/cli/base/places.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

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

void AddJson(CLI::App& verb, const std::string& schema, bool& json, const std::string& help) {
  verb.add_flag("--json", json, absl::StrCat(help, " (configs/schema/", schema, ".json)"));
}

void AddFullHashes(CLI::App& verb, bool& full) {
  verb.add_flag("--full-hashes", full,
                "All digits of hashes, not the first 12 (--json has them all)");
}

std::string HostOptions::configs_dir() const { return configs.empty() ? ConfigDir() : configs; }

std::string HostOptions::cache_dir() const { return CacheDir(cache); }

void AddHostOptions(CLI::App& verb, HostOptions& options) {
  verb.add_option("--configs", options.configs,
                  "Folder with tracks/ and server.json (default: MYOGRADE_CONFIG_DIR, else the "
                  "configs that MyoGrade came with)");
  verb.add_option("--cache", options.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "~/.cache/myograde if it has models, else /var/cache/myograde)");
}

}  // namespace myograde::server
