// The verbs that become another program: myograde serve, the daemon; myograde runtime, mostly the
// maker of runtimes
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/cli/base/verbs.h"
#include "server/cli/offline/local.h"
#include "server/cli/terminal/terminal.h"
#include "server/config/server_config.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

// Returns only if the program can't be started: the error, with `what` it is and what is `todo`.
absl::Status Become(std::vector<std::string> words, const std::string& what,
                    const std::string& todo) {
  ::execv(words[0].c_str(), ExecVector(words).data());
  return absl::InternalError(
      absl::StrCat(what, words[0], " can't be started: ", std::strerror(errno), todo));
}

struct ServeOptions {
  std::string data;
  std::string socket;
  HostOptions host;
  bool adopt = false;
};

absl::StatusOr<int> Serve(const ServeOptions& options) {
  ASSIGN_OR_RETURN(const std::string bin, HostStatus("", BinDir()));
  std::vector<std::string> words = {bin + "/myograded"};
  const std::pair<const char*, std::string> passed[] = {{"--data", options.data},
                                                        {"--socket", options.socket},
                                                        {"--configs", options.host.configs},
                                                        {"--cache", options.host.cache}};
  for (const auto& [name, value] : passed) {
    if (!value.empty()) words.insert(words.end(), {name, value});
  }
  if (options.adopt) words.emplace_back("--adopt");
  return Become(std::move(words), "the daemon's program ", "");
}

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
  return absl::NotFoundError(absl::StrCat(
      "there is no recipe \"", name,
      "\"; give a requirements file or one of the recipes ", absl::StrJoin(known, ", ")));
}

// Becomes the program that makes and removes runtimes. `words` follow the runtimes' folder and the
// name.
absl::StatusOr<int> BecomeMaker(const RuntimeOptions& options, const std::string& verb,
                                const std::vector<std::string>& words) {
  ASSIGN_OR_RETURN(const ServerConfig config, BuildServerConfig(options.host));
  if (const auto own = config.runtimes.find(options.name);
      own != config.runtimes.end() && own->second != config.runtimes_dir + "/" + options.name) {
    return absl::InvalidArgumentError(
        absl::StrCat("server.json names the folder ", own->second, " as the runtime \"",
                     options.name, "\"; choose another name, or take it out of \"runtimes\""));
  }
  std::vector<std::string> all = {"/usr/bin/python3", "-B", "-s", "-E",
                                  ShareDir() + "/runtime/make_runtime.py",
                                  verb, config.runtimes_dir, options.name};
  all.insert(all.end(), words.begin(), words.end());
  if (options.json) all.emplace_back("--json");
  return Become(std::move(all), "", "; install the package python3");
}

absl::StatusOr<int> Add(const RuntimeOptions& options) {
  std::string source = options.requirements;
  if (source.empty()) {
    ASSIGN_OR_RETURN(source, Recipe(options.name));
  }
  std::vector<std::string> words = {source, "--python", options.python};
  words.insert(words.end(), {"--timeout", std::to_string(options.timeout_s)});
  words.insert(words.end(), {"--most-bytes", std::to_string(options.most_bytes)});
  for (const std::string& package : options.debian) {
    words.insert(words.end(), {"--debian", package});
  }
  if (!options.wheels.empty()) words.insert(words.end(), {"--wheels", options.wheels});
  if (options.lock) words.emplace_back("--lock");
  if (options.replace) words.emplace_back("--replace");
  return BecomeMaker(options, "add", words);
}

void PrintRuntimes(const Json& answer) {
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
  PrintList(answer, "runtimes", "There are no runtimes yet; build one with \"myograde runtime "
                                "add\".",
            {"runtime", "Python=python", RowColumn("packages", packages),
             RowColumn("MB", megabytes), RowColumn("digest", digest), "folder"});
}

absl::StatusOr<int> List(const RuntimeOptions& options) {
  ASSIGN_OR_RETURN(const ServerConfig config, BuildServerConfig(options.host));
  const Runtimes runtimes(config.runtimes, config.runtimes_dir);
  Json rows = Json::array();
  for (const bool former : {false, true}) {
    for (const Runtime& runtime : former ? runtimes.Former() : runtimes.List()) {
      rows.push_back(RuntimeToJson(runtime));
      rows.back().update({{"folder", runtime.folder},
                          {"configured", runtime.configured},
                          {"former", former}});
    }
  }
  return PrintAnswer(Json{{"dir", config.runtimes_dir}, {"runtimes", rows}}, options.json,
                     PrintRuntimes);
}

}  // namespace

Command AddServe(CLI::App& verb) {
  auto options = std::make_shared<ServeOptions>();
  verb.add_option("--data", options->data,
                  "Folder for all of the daemon's data; created if missing (default: "
                  "MYOGRADE_DATA, "
                  "else /var/lib/myograde for root and ~/.local/share/myograde for others)");
  verb.add_option("--socket", options->socket, "Where to listen (default: DATA/myograde.sock)");
  verb.add_flag("--adopt", options->adopt,
                "Only take over a copy of another daemon's data folder, where leases run on a "
                "cluster (OPERATIONS.md, 'Copies of a data folder'); stop the daemon first");
  AddHostOptions(verb, options->host);
  return [options] { return Serve(*options); };
}

Command AddRuntime(CLI::App& verb) {
  Parts<RuntimeOptions> parts(verb);
  RuntimeOptions& options = parts.options();
  const auto add = [&](const char* name, const char* does, const char* example, const char* schema,
                       absl::StatusOr<int> (*action)(const RuntimeOptions&)) {
    CLI::App* part = parts.Add(name, does, example, action);
    AddJson(*part, schema, options.json);
    AddHostOptions(*part, options.host);
    return part;
  };
  CLI::App* part =
      add("add", "Build a runtime from a requirements file", "add torch-cpu", "runtime", Add);
  part->add_option("NAME", options.name, "Its name in policy.json: a-z, 0-9, \".\", \"_\", \"-\"")
      ->required();
  part->add_option("REQUIREMENTS", options.requirements,
                   "Requirements file of pip in which each package has a version and a SHA-256, or "
                   "a folder with a requirements.txt and a debian.txt (default: the shipped recipe "
                   "of that name)");
  part->add_option("--debian", options.debian,
                   "Python package of Debian to add, with its dependencies; may be repeated");
  part->add_flag("--lock", options.lock,
                 "First resolve versions and hashes, and write them beside the requirements file");
  part->add_flag("--replace", options.replace,
                 "Replace the runtime of that name; evaluations that started with the old one keep "
                 "it");
  part->add_option("--python", options.python,
                   "Python to run policies with, below /usr (others: only in images)")
      ->capture_default_str();
  part->add_option("--wheels", options.wheels,
                   "Folder to install the packages from, instead of the network");
  part->add_option("--most-bytes", options.most_bytes, "Largest unpacked size in bytes")
      ->check(WholeNumber(1, "not a size"))
      ->capture_default_str();
  part->add_option("--timeout", options.timeout_s,
                   "Time limit for fetching the packages, in seconds")
      ->check(WholeNumber(1, "not a time"))
      ->capture_default_str();
  add("list", "List the runtimes of this host", "list", "runtimes", List);
  CLI::App* remove = add("remove", "Remove a runtime and its former versions", "remove torch",
                         "runtime-remove", [](const RuntimeOptions& of) {
                           std::vector<std::string> words;
                           if (of.former) words.emplace_back("--former");
                           return BecomeMaker(of, "remove", words);
                         });
  remove->add_option("NAME", options.name, "Its name")->required();
  remove->add_flag("--former", options.former, "Only the replaced versions");
  return {};
}

}  // namespace myograde::server
