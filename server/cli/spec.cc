// myograde spec
#include <algorithm>
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/layout.h"
#include "protocol/rules_leg.h"
#include "server/cli/common.h"
#include "server/cli/table.h"
#include "server/cli/terminal.h"
#include "server/counted.h"
#include "server/daemon/tracks.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using nlohmann::literals::operator""_json_pointer;

struct SpecOptions {
  HostOptions host;
  std::string track;
  std::string profile;
  bool full_hashes = false;
  bool json = false;
};

Json LayoutJson(std::span<const Part> parts, std::span<const std::string_view> names) {
  Json list = Json::array();
  for (const Part& part : parts) {
    Json entries = Json::array();
    for (int i = 0; i < part.size; ++i) {
      entries.push_back(names[static_cast<size_t>(part.offset + i)]);
    }
    list.push_back({{"name", part.name},
                    {"offset", part.offset},
                    {"size", part.size},
                    {"unit", part.unit},
                    {"meaning", part.meaning},
                    {"entries", entries}});
  }
  return list;
}

Json BoundsJson(const std::vector<Bounds>& bounds) {
  Json low = Json::array();
  Json high = Json::array();
  for (const Bounds& bound : bounds) {
    low.push_back(bound.low);
    high.push_back(bound.high);
  }
  return {{"low", low}, {"high", high}};
}

Json SpecJson(const TrackConfig& config, const Tracks::Offer& offer) {
  Json profiles = Json::object();
  for (const auto& [name, track] : offer.profiles) {
    profiles[name] = {{"config", track->config.hash},
                      {"episodes", track->config.seeds.size()},
                      {"episodes_per_lease", track->config.episodes_per_lease},
                      {"rules", track->config.rules},
                      {"scoring", track->config.scoring}};
  }
  return {{"track", config.id},
          {"kind", TrackKindName(config.kind)},
          {"profile", config.profile},
          {"default_profile", offer.default_profile},
          {"config", config.hash},
          {"protocol_version", 1},
          {"control_period_s", ControlPeriod(config.kind)},
          {"episodes", config.seeds.size()},
          {"episodes_per_lease", config.episodes_per_lease},
          {"seeds", config.seeds},
          {"policy_seed_secret", config.policy_seed_secret.has_value()
                                     ? Json(*config.policy_seed_secret) : Json()},
          {"observation",
           {{"size", ObservationSize(config.kind)},
            {"parts", LayoutJson(ObservationLayout(config.kind), ObservationNames(config.kind))},
            {"bounds", BoundsJson(ObservationBounds(config.kind))}}},
          {"action",
           {{"size", ActionSize(config.kind)},
            {"parts", LayoutJson(ActionLayout(config.kind), ActionNames(config.kind))},
            {"bounds",
             {{"normalized", BoundsJson(ActionBounds(config.kind, ActionConvention::kNormalized))},
              {"direct", BoundsJson(ActionBounds(config.kind, ActionConvention::kDirect))}}}}},
          {"budgets", config.effective.value("budgets", Json::object())},
          {"rules", config.rules},
          {"scoring", config.scoring},
          {"profiles", profiles}};
}

void PrintLayout(const char* title, std::span<const Part> parts, int size) {
  std::cout << '\n' << Bold(absl::StrCat(title, ": ", size, " numbers")) << '\n';
  Table table({"entries", "name", "unit", "meaning"});
  for (const Part& part : parts) {
    const std::string range =
        part.size == 1 ? absl::StrCat(part.offset)
                       : absl::StrCat(part.offset, "..", part.offset + part.size - 1);
    table.Add({range, std::string(part.name), std::string(part.unit), std::string(part.meaning)});
  }
  table.Print();
}

// "budgets.step_s" -> value, for every leaf but comments.
void Flatten(const Json& json, const std::string& prefix, std::map<std::string, std::string>& out) {
  for (const auto& [key, value] : json.items()) {
    if (key.starts_with("//")) continue;
    const std::string path = prefix.empty() ? key : prefix + "." + key;
    if (value.is_object()) {
      Flatten(value, path, out);
    } else {
      out[path] = Harmless(value.dump());
    }
  }
}

// The prosthesis' parameter sets are too much for a line; they are told in a table of their own.
Json WithoutSets(Json rules) {
  const Json::json_pointer place("/leg/parameter_sets");
  if (!rules.contains(place)) return rules;
  std::vector<std::string> names;
  for (const Json& set : rules[place]) names.push_back(set.value("name", ""));
  rules[place] = names.empty() ? "all the official default" : absl::StrJoin(names, ", ");
  return rules;
}

std::string JointText(const Json& joint) {
  return absl::StrCat(joint["stiffness"].dump(), ", ", joint["damping"].dump(), ", ",
                      joint["target_deg"].dump());
}

void PrintSets(const Json& rules) {
  const Json sets = rules.value("/leg/parameter_sets"_json_pointer, Json::array());
  if (sets.empty()) return;
  std::cout
      << '\n'
      << Bold("Parameter sets of the prosthesis until a policy uploads its own") << '\n'
      << "  (stiffness in N m/rad, damping in N m s/rad, target in degrees; loads in parts of "
         "the person's weight)\n";
  Table table({"set", "state", "knee", "ankle", "left when"});
  for (size_t i = 0; i < sets.size(); ++i) {
    for (const char* state : kLegStateKeys) {
      const Json& said = sets[i][state];
      std::vector<std::string> until;
      for (const auto& [key, value] : said["until"].items()) {
        until.push_back(absl::StrCat(key, " ", value.dump()));
      }
      table.Add({absl::StrCat(i, " ", Harmless(sets[i].value("name", ""))), state,
                 JointText(said["knee"]), JointText(said["ankle"]), absl::StrJoin(until, ", or ")});
    }
  }
  table.Print();
}

void PrintValues(const char* title, const Json& json) {
  std::cout << '\n' << Bold(title) << '\n';
  std::map<std::string, std::string> values;
  Flatten(json, "", values);
  Table table({"key", "value"});
  for (const auto& [key, value] : values) table.Add({key, value});
  table.Print();
}

void PrintDifferences(const Tracks::Offer& offer) {
  std::map<std::string, std::map<std::string, std::string>> by_profile;
  std::map<std::string, std::string> all;
  for (const auto& [name, track] : offer.profiles) {
    Json said = {{"rules", WithoutSets(track->config.rules)},
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

void PrintSpec(const TrackConfig& config, const Tracks::Offer& offer, bool full_hashes) {
  std::cout << Bold(absl::StrCat("Track ", config.id, " in the profile ", config.profile)) << '\n'
            << "  " << Counted(std::ssize(config.seeds), "episode") << " in blocks of "
            << config.episodes_per_lease << ", each played by a fresh process of the policy; a "
            << "control step every " << ControlPeriod(config.kind) << " s\n"
            << "  config hash " << HashText(config.hash, full_hashes) << '\n';
  PrintLayout("Observation", ObservationLayout(config.kind), ObservationSize(config.kind));
  PrintLayout("Action", ActionLayout(config.kind), ActionSize(config.kind));
  std::cout
      << "\nA policy chooses at the handshake how it acts: normalized (every number in [-1, 1])\n"
         "or direct (muscles in [0, 1], prosthesis targets in rad); --json has the bounds and\n"
         "the name of every entry.\n";
  PrintValues("Budgets", config.effective.value("budgets", Json::object()));
  PrintValues("Rules", WithoutSets(config.rules));
  PrintSets(config.rules);
  PrintValues("Scoring", config.scoring);
  PrintDifferences(offer);
}

int ListTracksOnOffer(const Tracks& tracks, bool json) {
  Json list = Json::array();
  Table table({"track", "kind", "episodes", "profiles (the first is the default)"});
  for (const auto& [name, offer] : tracks.offers()) {
    std::vector<std::string> profiles = {offer.default_profile};
    for (const auto& [profile, track] : offer.profiles) {
      if (profile != offer.default_profile) profiles.push_back(profile);
    }
    const TrackConfig& config = offer.profiles.at(offer.default_profile)->config;
    table.Add({name, TrackKindName(config.kind), absl::StrCat(config.seeds.size()),
               absl::StrJoin(profiles, ", ")});
    list.push_back({{"track", name},
                    {"kind", TrackKindName(config.kind)},
                    {"default_profile", offer.default_profile},
                    {"episodes", config.seeds.size()},
                    {"profiles", profiles}});
  }
  if (json) {
    PrintJson({{"tracks", list}});
  } else {
    table.Print();
  }
  return kDone;
}

int Spec(const SpecOptions& options) {
  const absl::StatusOr<Tracks> tracks = Tracks::Load(options.host.configs_dir() + "/tracks");
  if (!tracks.ok()) return Complain(HostStatus("", tracks.status()));
  if (options.track.empty()) return ListTracksOnOffer(*tracks, options.json);
  const absl::StatusOr<TrackPtr> track = tracks->Find(options.track, options.profile);
  if (!track.ok()) return Complain(track.status());
  const Tracks::Offer& offer = tracks->offers().at(options.track);
  if (options.json) {
    PrintJson(SpecJson((*track)->config, offer));
  } else {
    PrintSpec((*track)->config, offer, options.full_hashes);
  }
  return kDone;
}

}  // namespace

Action AddSpec(CLI::App& verb) {
  auto options = std::make_shared<SpecOptions>();
  verb.add_option("--track", options->track, "Name of the track (default: list them all)");
  verb.add_option("--profile", options->profile, "Rules profile (default: the track's own)");
  AddFullHashes(verb, options->full_hashes);
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/spec.json)");
  AddHostOptions(verb, options->host);
  return [options] { return Spec(*options); };
}

}  // namespace myograde::server
