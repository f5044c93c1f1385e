// myograde runtime
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"
#include "server/config/server_config.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

struct RuntimeOptions {
  HostOptions host;
  std::string name;
  std::string requirements;
  std::string python = "/usr/bin/python3";
  std::string wheels;
  std::vector<std::string> debian;
  int64_t most_bytes = int64_t{8} << 30;
  int64_t timeout_s = 3600;
  bool lock = false;
  bool replace = false;
  bool former = false;
  bool json = false;
};

absl::StatusOr<ServerConfig> ConfigOf(const RuntimeOptions& options) {
  return HostStatus(
      "", LoadServerConfig(options.host.configs_dir() + "/server.json", options.host.cache_dir()));
}

// The program that makes and removes runtimes.
std::string Maker() { return ShareDir() + "/runtime/make_runtime.py"; }

// The folder of a shipped recipe; NotFoundError lists those that there are.
absl::StatusOr<std::string> Recipe(const std::string& name) {
  namespace fs = std::filesystem;
  const std::string recipes = ShareDir() + "/runtimes";
  if (IsRuntimeName(name) && fs::exists(absl::StrCat(recipes, "/", name, "/requirements.txt"))) {
    return absl::StrCat(recipes, "/", name);
  }
  std::set<std::string> known;
  std::error_code ignored;  // without the folder there are none
  for (const fs::directory_entry& entry : fs::directory_iterator(recipes, ignored)) {
    if (entry.is_directory(ignored)) known.insert(entry.path().filename().string());
  }
  return absl::NotFoundError(absl::StrCat("there is no recipe \"", name, "\"; give a requirements ",
                                          "file, or the name of one of these: ",
                                          absl::StrJoin(known, ", ")));
}

// Becomes the maker. `words` follow the runtimes' folder and the name.
absl::StatusOr<int> Become(const RuntimeOptions& options, const std::string& verb,
                           std::vector<std::string> words) {
  ASSIGN_OR_RETURN(const ServerConfig config, ConfigOf(options));
  if (const auto own = config.runtimes.find(options.name);
      own != config.runtimes.end() && own->second != config.runtimes_dir + "/" + options.name) {
    return absl::InvalidArgumentError(
        absl::StrCat("server.json names the folder ", own->second, " as the runtime \"",
                     options.name, "\"; choose another name, or take it out of \"runtimes\""));
  }
  std::vector<std::string> all = {"/usr/bin/python3",  "-B",        "-s", "-E", Maker(), verb,
                                  config.runtimes_dir, options.name};
  all.insert(all.end(), words.begin(), words.end());
  if (options.json) all.emplace_back("--json");
  ::execv(all[0].c_str(), ExecVector(all).data());
  return absl::InternalError(absl::StrCat(all[0], " can't be started: ", std::strerror(errno),
                                          "; install the package python3"));
}

absl::StatusOr<int> Add(const RuntimeOptions& options) {
  std::string source = options.requirements;
  if (source.empty()) {
    ASSIGN_OR_RETURN(source, Recipe(options.name));
  }
  std::vector<std::string> words = {source,
                                    "--python",
                                    options.python,
                                    "--timeout",
                                    std::to_string(options.timeout_s),
                                    "--most-bytes",
                                    std::to_string(options.most_bytes)};
  for (const std::string& package : options.debian) {
    words.insert(words.end(), {"--debian", package});
  }
  if (!options.wheels.empty()) words.insert(words.end(), {"--wheels", options.wheels});
  if (options.lock) words.emplace_back("--lock");
  if (options.replace) words.emplace_back("--replace");
  return Become(options, "add", std::move(words));
}

absl::StatusOr<int> Remove(const RuntimeOptions& options) {
  return Become(options, "remove",
                options.former ? std::vector<std::string>{"--former"} : std::vector<std::string>());
}

Json RuntimeRow(const Runtime& runtime, bool former) {
  Json row = RuntimeToJson(runtime);
  row["folder"] = runtime.folder;
  row["configured"] = runtime.configured;
  row["former"] = former;
  return row;
}

void PrintRuntimes(const Json& runtimes) {
  const auto packages = [](const Json& row) {
    return row["digest"].is_string() ? std::to_string(row["packages"].size()) : "-";
  };
  const auto megabytes = [](const Json& row) {
    return row["digest"].is_string()
               ? absl::StrFormat("%.0f", static_cast<double>(row["bytes"]) / 1e6)
               : "-";
  };
  const auto digest = [](const Json& row) {
    return absl::StrCat(row["digest"].is_string() ? HashText(row["digest"], false) : "unknown",
                        row.value("former", false) ? " (former)" : "");
  };
  PrintRows(runtimes, {"runtime", "Python=python", RowColumn("packages", packages),
                       RowColumn("MB", megabytes), RowColumn("digest", digest), "folder"});
}

absl::StatusOr<int> List(const RuntimeOptions& options) {
  ASSIGN_OR_RETURN(const ServerConfig config, ConfigOf(options));
  const Runtimes runtimes(config.runtimes, config.runtimes_dir);
  Json rows = Json::array();
  for (const Runtime& runtime : runtimes.List()) rows.push_back(RuntimeRow(runtime, false));
  for (const Runtime& runtime : runtimes.Former()) rows.push_back(RuntimeRow(runtime, true));
  if (options.json) {
    PrintJson({{"dir", config.runtimes_dir}, {"runtimes", rows}});
  } else if (rows.empty()) {
    std::cout << "There is no runtime; myograde runtime add makes one." << std::endl;
  } else {
    PrintRuntimes(rows);
  }
  return kDone;
}

void AddMaking(CLI::App& part, RuntimeOptions& options) {
  part.add_option("NAME", options.name, "Its name in policy.json: a-z, 0-9, \".\", \"_\", \"-\"")
      ->required();
  part.add_option("REQUIREMENTS", options.requirements,
                  "Requirements file of pip in which each package has a version and a SHA-256, or a "
                  "folder with a requirements.txt and a debian.txt (default: the shipped recipe of "
                  "that name)");
  part.add_option("--debian", options.debian,
                  "Python package of Debian to add, with what it needs; may be repeated");
  part.add_flag("--lock", options.lock,
                "Find versions and hashes first, and write them beside the requirements file");
  part.add_flag("--replace", options.replace,
                "Replace the runtime of that name; evaluations that began with it keep it");
  part.add_option("--python", options.python,
                  "Python that policies will run it with; below /usr (others: in images only)")
      ->capture_default_str();
  part.add_option("--wheels", options.wheels,
                  "Folder to take the packages from instead of the network");
  part.add_option("--most-bytes", options.most_bytes, "Largest unpacked size in bytes")
      ->check(WholeNumber(1, "no size"))
      ->capture_default_str();
  part.add_option("--timeout", options.timeout_s, "Seconds that getting the packages may take")
      ->check(WholeNumber(1, "no time"))
      ->capture_default_str();
}

}  // namespace

Action AddRuntime(CLI::App& verb) {
  Parts<RuntimeOptions> parts(verb);
  RuntimeOptions& options = parts.options();
  const auto add = [&](const char* name, const char* does, const char* example, const char* schema,
                       absl::StatusOr<int> (*action)(const RuntimeOptions&)) {
    CLI::App* part = parts.Add(name, does, example, action);
    AddJson(*part, schema, options.json);
    AddHostOptions(*part, options.host);
    return part;
  };
  AddMaking(*add("add", "Make a runtime from a requirements file", "add torch-cpu", "runtime", Add),
            options);
  add("list", "List the runtimes of this host", "list", "runtimes", List);
  CLI::App* remove = add("remove", "Remove a runtime and its former versions", "remove torch",
                         "runtime-remove", Remove);
  remove->add_option("NAME", options.name, "Its name")->required();
  remove->add_flag("--former", options.former, "Only those that were replaced");
  return parts.Chosen();
}

}  // namespace myograde::server
