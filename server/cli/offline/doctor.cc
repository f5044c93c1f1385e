// myograde doctor
#include "server/sandbox/doctor.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <vector>

#include "server/base/paths.h"
#include "server/challenge/offered_tracks.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/offline/cluster_checks.h"
#include "server/cli/terminal/terminal.h"
#include "server/config/server_config.h"
#include "server/proof/reference_check.h"
#include "server/runtime/runtimes.h"
#include "server/store/journal.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

struct DoctorVerb {
  HostOptions host;
  std::string data;
  bool sandbox = false;
  bool cluster = false;
  bool json = false;
  bool probe_bus = false;
};

// Tracks without reference episodes, if there are any.
void AddReferenceCheck(const Tracks& tracks, const std::string& reference,
                       std::vector<Check>& checks) {
  const References references(reference);
  std::vector<std::string> lacking;
  for (const auto& [name, offer] : tracks.entries()) {
    const std::string why =
        references.WhyLacking(offer.profiles.at(offer.default_profile)->config.kind->name);
    if (!why.empty()) lacking.push_back(absl::StrCat("the track ", name, ": ", why));
  }
  if (lacking.empty()) return;
  checks.push_back({"reference", CheckState::kDegraded, absl::StrJoin(lacking, "; "),
                    "ranked submissions to these tracks are refused; practice is graded",
                    "record their reference episodes (configs/README.md, 'How to add a track')"});
}

// What the configs say, as far as they can be read; what can't is a check that
// found something missing.
DoctorOptions Gather(const DoctorVerb& verb, std::vector<Check>& checks,
                     std::optional<ServerConfig>& server) {
  const auto absolute = [](const std::string& path) {
    return std::filesystem::absolute(path).lexically_normal().string();
  };
  DoctorOptions options;
  const absl::StatusOr<std::string> bin_dir = BinDir();
  options.bin_dir = bin_dir.ok() ? absolute(*bin_dir) : "";
  options.config_dir = absolute(verb.host.configs_dir());
  options.cache_dir = verb.host.cache_dir();
  options.data_dir = absolute(DataDir(verb.data));

  std::string mistake;
  const absl::StatusOr<ServerConfig> config =
      LoadServerConfig(options.config_dir + "/server.json", options.cache_dir);
  if (config.ok()) {
    server = *config;
    options.runtimes = config->runtimes;
    const Runtimes runtimes(config->runtimes, config->runtimes_dir);
    for (const Runtime& runtime : runtimes.List()) options.runtimes[runtime.name] = runtime.folder;
    options.check_runtime = [runtimes](const std::string& name) {
      const absl::StatusOr<Runtime> runtime = runtimes.Find(name);
      return runtime.ok() ? CheckRuntime(*runtime) : runtime.status();
    };
    options.uid_base = config->uid_base;
    options.slots = config->scheduler.slots;
    options.submission_bytes = config->artefacts.bytes;
    options.disk_reserve = config->artefacts.disk_reserve;
  } else {
    mistake = std::string(config.status().message());
    options.uid_base = 62000;  // any that is free will do for a trial
  }
  const absl::StatusOr<Tracks> tracks = Tracks::Load(options.config_dir + "/tracks");
  if (!tracks.ok()) {
    mistake = std::string(tracks.status().message());
  } else if (tracks->entries().empty()) {
    mistake = options.config_dir + "/tracks has no track configs";
  } else {
    // The largest budget of memory is the one that a host must be able to give.
    for (const auto& [name, offer] : tracks->entries()) {
      const TrackConfig& track = offer.profiles.at(offer.default_profile)->config;
      if (!options.track || track.budgets.memory_bytes > options.track->budgets.memory_bytes) {
        options.track = track;
      }
    }
  }
  if (mistake.empty()) {
    checks.push_back({"configs", CheckState::kOk,
                      absl::StrCat(tracks->entries().size(), " tracks in ", options.config_dir), "",
                      ""});
  } else {
    checks.push_back({"configs", CheckState::kMissing, mistake,
                      "neither a daemon nor a local run can start",
                      "fix the file, or name another folder with --configs"});
  }
  if (tracks.ok()) AddReferenceCheck(*tracks, options.config_dir + "/reference", checks);
  return options;
}

// What a daemon that works on the data folder says of this host.
Check DaemonCheck(const std::string& data_dir) {
  ServerChoice daemon;
  daemon.address.socket = data_dir + "/myograde.sock";
  const absl::StatusOr<Json> health = Client(daemon).Get("/v1/health");
  if (!health.ok()) {
    return {"daemon", CheckState::kOk, absl::StrCat("none is running on ", data_dir), "", ""};
  }
  const std::string state = health->value("status", "");
  const std::string found = Filled(*health, "process {pid} is running on ") + data_dir;
  if (state == "ok") return {"daemon", CheckState::kOk, found, "", ""};
  return {"daemon", CheckState::kMissing, found + Filled(*health, ", and reports: {message}"),
          "no lease starts until this ends; submissions wait",
          state == "paused" ? "fix what the other checks or the reason report; the daemon tests "
                              "the host again by itself"
                            : "fix what the reason reports; the daemon tries again by itself"};
}

// Whether the public record in the data folder is as the daemon wrote it; nullopt: there is none that
// this user can read.
std::optional<Check> RecordCheck(const std::string& data_dir) {
  const std::string path = data_dir + "/store.db";
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  ReaderPool readers(path);
  std::optional<Damage> first;
  const absl::Status read = readers.Read([&](const Transaction& reader) {
    reader.journal.ForEachEntry(0, "", [&](const RecordRow*, std::optional<Damage> damage) {
      first = std::move(damage);
      return !first.has_value();
    });
    return absl::OkStatus();
  });
  if (!read.ok()) return std::nullopt;
  if (!first.has_value()) {
    return Check{"record", CheckState::kOk,
                 absl::StrCat("the public record in ", path, " is intact"), "", ""};
  }
  return Check{"record", CheckState::kDegraded, DamageText(*first),
               "nobody can check earlier results; grading continues",
               "restore the store from a backup, or explain the gap to those who check the record"};
}

// "a, b" of a list, "name=value, ..." of an object.
std::string Words(const Json& json) {
  std::string text;
  for (const auto& [key, value] : json.items()) {
    const std::string word = value.is_string() ? value.get<std::string>() : value.dump();
    absl::StrAppend(&text, text.empty() ? "" : ", ",
                    json.is_object() ? absl::StrCat(key, "=", word) : word);
  }
  return Sanitized(text.empty() ? "none" : text);
}

void PrintSandbox(const std::string& title, const Json& sandbox, const Json& staged) {
  std::cout << Bold(title) << '\n';
  const int64_t uid = sandbox["uid"].get<int64_t>();
  Table facts({"what", "value"});
  facts.Add({"process 1", Cell(sandbox, "process_1")});
  facts.Add({"user", absl::StrCat(uid < 0 ? std::string("the caller's own") : std::to_string(uid),
                                  " outside, ", Cell(sandbox, "uid_inside"), " inside")});
  facts.Add({"capabilities", Words(sandbox["capabilities"]) + "; no new privileges"});
  facts.Add({"own namespaces", Words(sandbox["namespaces"])});
  facts.Add({"network", Cell(sandbox, "network")});
  facts.Add({"limits per process", Words(sandbox["limits"])});
  facts.Add({"limits in total", Words(sandbox["control_group"])});
  if (sandbox.contains("scratch")) facts.Add({"/tmp and /dev/shm", Words(sandbox["scratch"])});
  facts.Add({"environment", Words(sandbox["environment"])});
  facts.Print();
  std::cout << '\n';
  Table mounts({"mount", "kind", "from"});
  for (const Json& mount : sandbox["mounts"]) {
    std::string source = Cell(mount, "source");
    for (const auto& [place, folder] : staged.items()) {
      if (source == place || source.starts_with(place + "/")) {
        source.replace(0, place.size(), folder.get<std::string>());
        break;
      }
    }
    mounts.Add({Sanitized(Cell(mount, "target")), Cell(mount, "kind"), Sanitized(source)});
  }
  mounts.Print();
  for (const auto& [kind, calls] : sandbox["system_calls"].items()) {
    std::cout << '\n' << "system calls " << kind << ": " << Words(calls) << '\n';
  }
  std::cout << '\n';
}

absl::StatusOr<int> Doctor(const DoctorVerb& verb) {
  if (verb.probe_bus) return ProbeBus();
  std::vector<Check> checks;
  std::optional<ServerConfig> server;
  const DoctorOptions options = Gather(verb, checks, server);
  if (verb.sandbox) {
    return PrintAnswer(DescribeSandboxes(options), verb.json, [](const Json& sandboxes) {
      PrintSandbox("The policy's sandbox", sandboxes["policy"], sandboxes["staged"]);
      PrintSandbox("The simulator's sandbox", sandboxes["simulator"], sandboxes["staged"]);
    });
  }
  std::vector<Check> found;
  if (!verb.cluster) {
    found = ExamineHost(options);
  } else if (server.has_value()) {
    found = ExamineCluster({*server, options.bin_dir, options.cache_dir, options.track});
  }
  checks.insert(checks.end(), found.begin(), found.end());
  if (const auto record = RecordCheck(options.data_dir)) checks.push_back(*record);
  checks.push_back(DaemonCheck(options.data_dir));
  CheckState worst = CheckState::kOk;
  Json list = Json::array();
  for (const Check& check : checks) {
    worst = std::max(worst, check.state);
    list.push_back({{"name", check.name},
                    {"state", CheckStateName(check.state)},
                    {"found", check.found},
                    {"costs", check.costs},
                    {"todo", check.todo}});
  }
  return PrintAnswer(
      Json{{"version", MYOGRADE_VERSION}, {"state", CheckStateName(worst)}, {"checks", list}},
      verb.json,
      [&](const Json& answer) {
        PrintChecks(answer["checks"], {"missing", "degraded"}, "\n",
                    "\n  costs: {costs}\n  to do: {todo}\n");
        std::cout << (verb.cluster ? "\nThe cluster" : "\nThis host")
                  << (worst == CheckState::kOk         ? " has everything that MyoGrade needs."
                      : worst == CheckState::kDegraded ? " can grade, at the cost named above."
                                                       : " can't grade yet: see above.")
                  << std::endl;
      },
      worst == CheckState::kMissing ? kTrouble : kDone);
}

}  // namespace

Command AddDoctor(CLI::App& verb) {
  auto options = std::make_shared<DoctorVerb>();
  verb.add_flag("--sandbox", options->sandbox,
                "Only print the two sandboxes of a lease as they are built on this host");
  verb.add_flag("--cluster", options->cluster,
                "Check the Slurm cluster of server.json instead of this host; runs a short job on "
                "one of its nodes")
      ->excludes("--sandbox");
  AddJson(verb, "doctor", options->json);
  verb.add_option("--data", options->data,
                  "The daemon's data folder (default: as for serve)");
  // What the doctor itself starts inside a sandbox.
  verb.add_flag("--probe-bus", options->probe_bus)->group("");
  AddHostOptions(verb, options->host);
  return [options] { return Doctor(*options); };
}

}  // namespace myograde::server
