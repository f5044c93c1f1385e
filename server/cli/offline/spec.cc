// What a policy begins with: myograde spec, new
#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/policy/layout.h"
#include "protocol/tracks/registry.h"
#include "server/base/counted.h"
#include "server/base/paths.h"
#include "server/challenge/offered_tracks.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

using nlohmann::literals::operator""_json_pointer;

struct SpecOptions {
  HostOptions host;
  std::string track;
  std::string profile;
  bool full_hashes = false;
  bool json = false;
};

Json BoundsJson(std::span<const Bounds> bounds) {
  Json json = {{"low", Json::array()}, {"high", Json::array()}};
  for (const Bounds& bound : bounds) {
    json["low"].push_back(bound.low);
    json["high"].push_back(bound.high);
  }
  return json;
}

Json LayoutJson(const VectorLayout& vector) {
  Json parts = Json::array();
  for (const Part& part : vector.parts()) {
    const auto first = vector.names().begin() + part.offset;
    parts.push_back({{"name", part.name},
                     {"offset", part.offset},
                     {"size", part.size},
                     {"unit", part.unit},
                     {"meaning", part.meaning},
                     {"entries", std::vector<std::string>(first, first + part.size)}});
  }
  return {{"size", vector.size()}, {"parts", parts}, {"bounds", BoundsJson(vector.bounds())}};
}

Json SpecJson(const TrackConfig& config, const Tracks::Entry& entry) {
  Json profiles = Json::object();
  for (const auto& [name, track] : entry.profiles) {
    profiles[name] = {{"config", track->config.hash},
                      {"episodes", track->config.seeds.size()},
                      {"episodes_per_lease", track->config.episodes_per_lease},
                      {"rules", track->config.rules},
                      {"scoring", track->config.scoring}};
  }
  Json extra = LayoutJson(ExtraOf(*config.kind));
  extra["allowed"] = config.extra_observations;
  Json action = LayoutJson(ActionOf(*config.kind));
  action["bounds"] = {{"normalized", action["bounds"]},
                      {"direct", BoundsJson(config.kind->layout().direct_bounds)}};
  return {{"track", config.id},
          {"kind", config.kind->name},
          {"profile", config.profile},
          {"default_profile", entry.default_profile},
          {"config", config.hash},
          {"protocol_version", 1},
          {"control_period_s", config.kind->control_period_s},
          {"episodes", config.seeds.size()},
          {"episodes_per_lease", config.episodes_per_lease},
          {"seeds", config.seeds},
          {"policy_seed_secret", config.policy_seed_secret},
          {"observation", LayoutJson(ObservationOf(*config.kind))},
          {"extra_observation", std::move(extra)},
          {"action", std::move(action)},
          {"budgets", config.effective.value("budgets", Json::object())},
          {"rules", config.rules},
          {"scoring", config.scoring},
          {"profiles", profiles}};
}

void PrintLayout(const char* title, const Json& vector) {
  const auto entries = [](const Json& part) {
    const int64_t first = part["offset"];
    const int64_t last = first + part["size"].get<int64_t>() - 1;
    return first == last ? absl::StrCat(first) : absl::StrCat(first, "..", last);
  };
  std::cout << '\n' << Bold(title + Filled(vector, ": {size} numbers")) << '\n';
  PrintRows(vector["parts"], {RowColumn("entries", entries), "name", "unit", "meaning"});
}

// "budgets.step_s" -> value, for every leaf but comments.
void Flatten(const Json& json, const std::string& prefix, std::map<std::string, std::string>& out) {
  for (const auto& [key, value] : json.items()) {
    if (key.starts_with("//")) continue;
    const std::string path = prefix.empty() ? key : prefix + "." + key;
    if (value.is_object()) {
      Flatten(value, path, out);
    } else {
      out[path] = Sanitized(value.dump());
    }
  }
}

std::vector<RulesTable> BuildTables(const TrackConfig& config) {
  return config.kind->tables == nullptr ? std::vector<RulesTable>()
                                        : config.kind->tables(config.rules);
}

// Rules with a table of their own would not fit on a line.
Json WithoutTables(const TrackConfig& config) {
  Json rules = config.rules;
  for (const RulesTable& table : BuildTables(config)) {
    const Json::json_pointer place(table.key);
    if (rules.contains(place)) rules[place] = table.summary;
  }
  return rules;
}

void PrintTables(const TrackConfig& config) {
  for (RulesTable& said : BuildTables(config)) {
    if (said.rows.empty()) continue;
    std::cout << '\n' << Bold(said.title) << '\n' << "  (" << said.note << ")\n";
    Table table(said.head);
    for (std::vector<std::string>& row : said.rows) {
      for (std::string& cell : row) cell = Sanitized(cell);
      table.Add(std::move(row));
    }
    table.Print();
  }
}

void PrintValues(const char* title, const Json& json) {
  std::cout << '\n' << Bold(title) << '\n';
  std::map<std::string, std::string> values;
  Flatten(json, "", values);
  Table table({"key", "value"});
  for (const auto& [key, value] : values) table.Add({key, value});
  table.Print();
}

void PrintDifferences(const Tracks::Entry& entry) {
  std::map<std::string, std::map<std::string, std::string>> by_profile;
  std::map<std::string, std::string> all;
  for (const auto& [name, track] : entry.profiles) {
    Json said = {{"rules", WithoutTables(track->config)},
                 {"scoring", track->config.scoring},
                 {"episodes_per_lease", track->config.episodes_per_lease}};
    Flatten(said, "", by_profile[name]);
    all.insert(by_profile[name].begin(), by_profile[name].end());
  }
  std::vector<std::string> head = {"key"};
  for (const auto& [name, values] : by_profile) head.push_back(name);
  Table table(head);
  for (const auto& [key, unused] : all) {
    std::vector<std::string> row = {key};
    for (auto& [name, values] : by_profile) {
      row.push_back(values.contains(key) ? values[key] : "-");
    }
    if (std::adjacent_find(row.begin() + 1, row.end(), std::not_equal_to<>()) != row.end()) {
      table.Add(std::move(row));
    }
  }
  std::cout << '\n' << Bold("Where the profiles differ") << '\n';
  table.Print();
}

void PrintSpec(const Json& spec, const TrackConfig& config, const Tracks::Entry& entry,
               bool full_hashes) {
  std::cout << Bold(absl::StrCat("Track ", config.id, " in the profile ", config.profile)) << '\n'
            << "  " << Counted(std::ssize(config.seeds), "episode") << " in blocks of "
            << config.episodes_per_lease << ", each played by a fresh process of the policy; a "
            << "control step every " << config.kind->control_period_s << " s\n"
            << "  config hash " << HashText(config.hash, full_hashes) << '\n';
  PrintLayout("Observation", spec["observation"]);
  const Json& extra = spec["extra_observation"];
  if (config.extra_observations && extra["size"] != 0) {
    PrintLayout("Extra observation (\"extra_observations\" in policy.json; behind the others)",
                extra);
  }
  PrintLayout("Command", spec["action"]);
  std::cout
      << "\nA policy chooses its kind of actions at the handshake: normalized (every number in "
         "[-1, 1])\n"
         "or direct (muscles in [0, 1], prosthesis targets in rad); --json has the bounds and\n"
         "the name of every entry.\n";
  PrintValues("Budgets", config.effective.value("budgets", Json::object()));
  PrintValues("Rules", WithoutTables(config));
  PrintTables(config);
  PrintValues("Scoring", config.scoring);
  PrintDifferences(entry);
}

absl::StatusOr<int> ListTracksOnOffer(const Tracks& tracks, bool json) {
  Json list = Json::array();
  for (const auto& [name, entry] : tracks.entries()) {
    std::vector<std::string> profiles = {entry.default_profile};
    for (const auto& [profile, track] : entry.profiles) {
      if (profile != entry.default_profile) profiles.push_back(profile);
    }
    const TrackConfig& config = entry.profiles.at(entry.default_profile)->config;
    list.push_back({{"track", name},
                    {"kind", config.kind->name},
                    {"default_profile", entry.default_profile},
                    {"episodes", config.seeds.size()},
                    {"profiles", profiles}});
  }
  return PrintAnswer(Json{{"tracks", list}}, json, [](const Json& answer) {
    PrintRows(answer["tracks"], {"track", "kind", "episodes",
                                 "profiles (the first is the default)=profiles"});
  });
}

absl::StatusOr<int> Spec(const SpecOptions& options) {
  ASSIGN_OR_RETURN(const Tracks tracks,
                   HostStatus("", Tracks::Load(options.host.configs_dir() + "/tracks")));
  if (options.track.empty()) return ListTracksOnOffer(tracks, options.json);
  ASSIGN_OR_RETURN(const TrackPtr track, tracks.Find(options.track, options.profile));
  const Tracks::Entry entry = tracks.entries().at(options.track);
  return PrintAnswer(
      SpecJson(track->config, entry), options.json,
      [&](const Json& spec) { PrintSpec(spec, track->config, entry, options.full_hashes); });
}

namespace fs = std::filesystem;

// A folder with a policy that plays as it is, for participants to begin with.
struct Starter {
  std::string lang;   // "cpp", "python" or "torch"
  std::string name;   // of the policy, as CheckPolicyName() takes it
  std::string track;  // that its README plays
};

constexpr size_t kLongestName = 64;  // of policy.json

absl::Status CantMake(const std::string& folder, const std::string& reason) {
  return absl::InvalidArgumentError(
      absl::StrCat(folder, ": can't be created: ", reason, "; choose another place with --output"));
}

absl::Status IsThere(const std::string& folder) {
  return absl::InvalidArgumentError(
      absl::StrCat(folder,
                   ": already exists and was left unchanged; choose another name, or another "
                   "place with --output"));
}

// Where an installation and a build tree have the templates of a language, seen from the programs.
absl::StatusOr<std::string> FindTemplates(const std::string& lang) {
  ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
  for (const std::string& place : {ShareDir(bin_dir) + "/policies", bin_dir + "/../policies"}) {
    const std::string templates = absl::StrCat(place, "/starter/", lang);
    std::error_code error;
    if (fs::exists(templates + "/README.md", error)) return templates;
  }
  return absl::InternalError(absl::StrCat("the template for ", lang,
                                          " is missing beside the programs in ", bin_dir,
                                          "; install MyoGrade again, or build the target "
                                          "myograde_policies"));
}

// One file of a template. `from` is a file of this installation.
absl::Status WriteFrom(const Starter& starter, const std::string& from, const std::string& to) {
  const absl::StatusOr<std::string> text = ReadFile(from);
  if (!text.ok()) return absl::InternalError(text.status().message());
  RETURN_IF_ERROR(WriteFile(
      to, absl::StrReplaceAll(*text, {{"@NAME@", starter.name}, {"@TRACK@", starter.track}})));
  if (::access(from.c_str(), X_OK) != 0) return absl::OkStatus();
  using fs::perms;
  std::error_code error;
  fs::permissions(to, perms::owner_exec | perms::group_exec | perms::others_exec,
                  fs::perm_options::add, error);
  return error ? CantMake(to, error.message()) : absl::OkStatus();
}

// All files of a template in the new folder `folder`; their names, sorted.
absl::StatusOr<std::vector<std::string>> WriteAllFrom(const Starter& starter,
                                                      const std::string& templates,
                                                      const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  if (!fs::create_directory(folder, error)) return CantMake(folder, error.message());
  fs::recursive_directory_iterator entry(templates, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().lexically_relative(templates).string();
    const std::string to = absl::StrCat(folder, "/", name);
    if (entry->is_directory(error)) {
      fs::create_directory(to, error);
      if (error) return CantMake(to, error.message());
    } else {
      RETURN_IF_ERROR(WriteFrom(starter, entry->path(), to));
      names.push_back(name);
    }
  }
  if (error) return absl::InternalError(absl::StrCat(templates, ": ", error.message()));
  std::sort(names.begin(), names.end());
  return names;
}

// "" if `name` can stand in sources, file names and policy.json; else what it must be.
std::string CheckPolicyName(const std::string& name) {
  if (IsSimpleName(name, kLongestName)) return "";
  return absl::StrCat("use a name of 1 to ", kLongestName,
                      " of the characters A-Z, a-z, 0-9, \"-\", \"_\" and \".\" that begins with "
                      "a letter or digit");
}

// Makes the new folder `folder` from the templates that came with this program, and returns the
// names of its files, sorted. The folder appears only when it is complete, and never in the place
// of something else. InvalidArgumentError if something has its name or it can't be written,
// InternalError if the templates are missing.
absl::StatusOr<std::vector<std::string>> WriteStarter(const Starter& starter,
                                                      const std::string& folder) {
  std::error_code error;
  if (fs::symlink_status(folder, error).type() != fs::file_type::not_found) {
    return error ? CantMake(folder, error.message()) : IsThere(folder);
  }
  ASSIGN_OR_RETURN(const std::string templates, FindTemplates(starter.lang));
  // Made beside its place, and removed with everything in it unless it gets its name.
  std::string part = folder + ".part-XXXXXX";
  if (::mkdtemp(part.data()) == nullptr) return CantMake(folder, std::strerror(errno));
  const std::string made = part + "/made";
  auto names = WriteAllFrom(starter, templates, made);
  // Over an empty folder at worst, if one appeared since.
  if (names.ok() && ::rename(made.c_str(), folder.c_str()) != 0) {
    const bool there = errno == EEXIST || errno == ENOTEMPTY || errno == ENOTDIR;
    names = there ? IsThere(folder) : CantMake(folder, std::strerror(errno));
  }
  std::error_code ignored;  // nobody is left to tell
  fs::remove_all(part, ignored);
  return names;
}

struct NewOptions {
  HostOptions host;
  Starter starter;
  std::string output;
  bool json = false;
};

// What to type in the folder: the commands of its README.
std::vector<std::string> ListCommands(const Starter& starter) {
  const std::string submission = starter.lang == "python" ? "." : "submission";
  return {
      starter.lang == "cpp" ? "./build.sh" : absl::StrCat("myograde spec --track ", starter.track),
      absl::StrCat("myograde local ", submission, " --track ", starter.track, " --episodes 1"),
      absl::StrCat("myograde submit ", submission, " --track ", starter.track,
                   " --team \"Team Blue\" --wait")};
}

void PrintMade(const std::string& folder, const Json& made) {
  std::cout << Bold(Sanitized(folder)) << ": a policy that is ready to run, in "
            << made["files"].size() << " files. Next:\n\n  cd " << Sanitized(folder) << '\n';
  for (const Json& command : made["commands"]) {
    std::cout << "  " << Sanitized(command.get<std::string>()) << '\n';
  }
  std::cout << "\nSee its README.md for more." << std::endl;
}

absl::StatusOr<int> New(const NewOptions& options) {
  ASSIGN_OR_RETURN(const Tracks tracks,
                   HostStatus("", Tracks::Load(options.host.configs_dir() + "/tracks")));
  const Starter& starter = options.starter;
  RETURN_IF_ERROR(tracks.Find(starter.track, "").status());
  // Without a slash at the end, so that a name beside it can be made.
  std::string folder = options.output.empty() ? starter.name : options.output;
  while (folder.size() > 1 && folder.ends_with('/')) folder.pop_back();
  ASSIGN_OR_RETURN(const std::vector<std::string> files, WriteStarter(starter, folder));
  return PrintAnswer(Json{{"folder", fs::absolute(folder).string()},
                          {"name", starter.name},
                          {"lang", starter.lang},
                          {"track", starter.track},
                          {"files", files},
                          {"commands", ListCommands(starter)}},
                     options.json, [&](const Json& made) { PrintMade(folder, made); });
}

}  // namespace

Command AddSpec(CLI::App& verb) {
  auto options = std::make_shared<SpecOptions>();
  verb.add_option("--track", options->track, "Name of the track (default: list them all)");
  verb.add_option("--profile", options->profile, "Rules profile (default: the track's own)");
  AddFullHashes(verb, options->full_hashes);
  AddJson(verb, "spec", options->json);
  AddHostOptions(verb, options->host);
  return [options] { return Spec(*options); };
}

Command AddNew(CLI::App& verb) {
  auto options = std::make_shared<NewOptions>();
  verb.add_option("NAME", options->starter.name, "Name of the policy and of its folder")
      ->required()
      ->check(CLI::Validator(CheckPolicyName, ""));
  verb.add_option("--lang", options->starter.lang, "Its language")
      ->required()
      ->check(CLI::IsMember({"cpp", "python", "torch"}));
  verb.add_option("--track", options->starter.track,
                  "Track in the commands of its README; the policy plays all tracks")
      ->default_val(TrackNames().front());
  verb.add_option("-o,--output", options->output,
                  "The folder to create, which must not exist (default: NAME in the current "
                  "folder)");
  AddJson(verb, "new", options->json);
  AddHostOptions(verb, options->host);
  return [options] { return New(*options); };
}

}  // namespace myograde::server
