// Track configs as files: what extends what, and which profiles a file has.
#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"

namespace myograde {
namespace {

namespace fs = std::filesystem;

constexpr char kPracticeSeeds[] = "practice_seeds";
constexpr char kExtraObservations[] = "extra_observations";

// A list of practice seeds belongs to the list of seeds that it was chosen beside: other seeds
// leave it behind.
void MergeOver(nlohmann::json& base, const nlohmann::json& patch) {
  if (patch.contains("seeds") && !patch.contains(kPracticeSeeds)) base.erase(kPracticeSeeds);
  base.merge_patch(patch);
}

// A file of a chain of configs, each of which extends the next one.
struct ChainFile {
  std::string name;   // of the track config; "": a file that a client sent
  std::string where;  // for messages
  nlohmann::json json;
};

// Removes "extends" and returns it; "": the file extends nothing.
absl::StatusOr<std::string> TakeExtends(nlohmann::json& json, const std::string& where) {
  if (!json.is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": must hold a JSON object"));
  }
  if (!json.contains("extends")) return "";
  if (!json["extends"].is_string() || json["extends"] == "") {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": \"extends\" must be the name of another track config"));
  }
  std::string next = json["extends"].get<std::string>();
  json.erase("extends");
  return next;
}

// The file of a track config, which the last of `chain` extends, if there is one.
absl::StatusOr<ChainFile> ReadChainFile(const std::string& tracks_dir, const std::string& name,
                                        const std::vector<ChainFile>& chain) {
  RETURN_IF_ERROR(CheckTrackName("track config", name));
  for (const ChainFile& seen : chain) {
    if (seen.name != name) continue;
    return absl::InvalidArgumentError(
        absl::StrCat(chain.back().where, ": \"extends\" leads back to \"", name,
                     "\"; let the chain of configs end at one that extends nothing"));
  }
  const std::string path = absl::StrCat(tracks_dir, "/", name, ".json");
  std::error_code error;
  if (!fs::exists(path, error)) {
    const absl::StatusOr<std::vector<std::string>> known = ListTracks(tracks_dir);
    const std::string by =
        chain.empty() ? ""
                      : absl::StrCat(", which ", fs::path(chain.back().where).filename().string(),
                                     " extends");
    return absl::NotFoundError(
        absl::StrCat("no track config \"", name, "\" in ", tracks_dir, by,
                     known.ok() ? absl::StrCat("; there are: ", absl::StrJoin(*known, ", ")) : ""));
  }
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  return ChainFile{name, path, std::move(json)};
}

// A config file merged over everything that it extends.
absl::StatusOr<nlohmann::json> MergeExtended(const std::string& tracks_dir, ChainFile file) {
  std::vector<ChainFile> chain;  // the requested one first
  for (;;) {
    ASSIGN_OR_RETURN(std::string next, TakeExtends(file.json, file.where));
    chain.push_back(std::move(file));
    if (next.empty()) break;
    ASSIGN_OR_RETURN(file, ReadChainFile(tracks_dir, next, chain));
  }
  nlohmann::json merged = nlohmann::json::object();
  for (auto it = chain.rbegin(); it != chain.rend(); ++it) MergeOver(merged, it->json);
  return merged;
}

absl::StatusOr<nlohmann::json> ReadExtended(const std::string& tracks_dir,
                                            const std::string& track) {
  ASSIGN_OR_RETURN(ChainFile file, ReadChainFile(tracks_dir, track, {}));
  return MergeExtended(tracks_dir, std::move(file));
}

// The merged file's profiles, checked to be an object of objects with valid names.
absl::StatusOr<nlohmann::json> ReadProfiles(const nlohmann::json& merged,
                                            const std::string& where) {
  const auto it = merged.find("profiles");
  if (it == merged.end() || !it->is_object() || it->empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": \"profiles\" must be an object with at least one profile"));
  }
  nlohmann::json profiles = *it;
  RemoveComments(profiles);
  static const std::set<std::string> kMayChange = {
      "episodes_per_lease", "seeds",   "practice_seeds", "extra_observations",
      "policy_seed_secret", "budgets", "rules",          "scoring"};
  for (const auto& [name, patch] : profiles.items()) {
    const std::string place = absl::StrCat(where, ": profile \"", name, "\"");
    if (absl::Status status = CheckTrackName("profile", name); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(where, ": ", status.message()));
    }
    if (!patch.is_object()) {
      return absl::InvalidArgumentError(absl::StrCat(place, " must be an object"));
    }
    for (const auto& [key, unused] : patch.items()) {
      if (kMayChange.contains(key)) continue;
      return absl::InvalidArgumentError(
          absl::StrCat(place, ": \"", key, "\" can't be changed by a profile; it can be: ",
                       absl::StrJoin(kMayChange, ", ")));
    }
  }
  return profiles;
}

absl::StatusOr<std::vector<uint64_t>> PracticeSeeds(const nlohmann::json& json,
                                                    const std::vector<uint64_t>& ranked,
                                                    const std::string& where) {
  absl::StatusOr<std::vector<uint64_t>> seeds =
      ParseSeeds(json, absl::StrCat(where, ": ", kPracticeSeeds));
  if (!seeds.ok()) return seeds;
  const std::set<uint64_t> known(ranked.begin(), ranked.end());
  for (const uint64_t seed : *seeds) {
    if (!known.contains(seed)) continue;
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": \"", kPracticeSeeds, "\" has the seed ", seed,
                     ", which \"seeds\" has too; practice must not play what is ranked"));
  }
  return seeds;
}

std::vector<std::string> KeysOf(const nlohmann::json& object) {
  std::vector<std::string> keys;
  for (const auto& [key, unused] : object.items()) keys.push_back(key);
  return keys;
}

// The config of one profile of `track`, whose files were merged.
absl::StatusOr<TrackConfig> ConfigOfProfile(nlohmann::json merged, const std::string& track,
                                            const std::string& profile, const std::string& where) {
  ASSIGN_OR_RETURN(nlohmann::json profiles, ReadProfiles(merged, where));
  std::string wanted = profile;
  if (wanted.empty()) {
    const auto it = merged.find("default_profile");
    if (it == merged.end() || !it->is_string() || !profiles.contains(*it)) {
      return absl::InvalidArgumentError(absl::StrCat(
          where, ": \"default_profile\" must be one of: ", absl::StrJoin(KeysOf(profiles), ", ")));
    }
    wanted = it->get<std::string>();
  }
  if (!profiles.contains(wanted)) {
    return absl::NotFoundError(
        absl::StrCat("track \"", track, "\" has no rules profile \"", wanted.substr(0, 80),
                     "\"; it has: ", absl::StrJoin(KeysOf(profiles), ", ")));
  }
  for (const char* key : {"id", "profile", "phase", "seed_salt"}) {
    if (!merged.contains(key)) continue;
    return absl::InvalidArgumentError(absl::StrCat(
        where, ": \"", key, "\" is given by the file's name and the caller; remove it"));
  }
  nlohmann::json effective = std::move(merged);
  effective.erase("profiles");
  effective.erase("default_profile");
  MergeOver(effective, profiles[wanted]);
  effective["id"] = track;
  effective["profile"] = wanted;
  const nlohmann::json practice = effective.value(kPracticeSeeds, nlohmann::json());
  const nlohmann::json extra = effective.value(kExtraObservations, nlohmann::json(false));
  effective.erase(kPracticeSeeds);
  effective.erase(kExtraObservations);
  const std::string place = absl::StrCat(where, " (profile ", wanted, ")");
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(effective, place);
  if (!config.ok()) return config;
  if (!extra.is_boolean()) {
    return absl::InvalidArgumentError(
        absl::StrCat(place, ": \"", kExtraObservations, "\" must be true or false"));
  }
  config->extra_observations = extra.get<bool>();
  if (practice.is_null()) return config;
  absl::StatusOr<std::vector<uint64_t>> seeds = PracticeSeeds(practice, config->seeds, place);
  if (!seeds.ok()) return seeds.status();
  config->practice_seeds = *std::move(seeds);
  return config;
}

}  // namespace

absl::StatusOr<TrackConfig> LoadTrackConfig(const std::string& tracks_dir,
                                            const std::string& track,
                                            const std::string& profile) {
  ASSIGN_OR_RETURN(nlohmann::json merged, ReadExtended(tracks_dir, track));
  return ConfigOfProfile(std::move(merged), track, profile,
                         absl::StrCat(tracks_dir, "/", track, ".json"));
}

absl::StatusOr<TrackConfig> ResolveTrackConfig(const std::string& tracks_dir,
                                               const std::string& track,
                                               const std::string& profile,
                                               const nlohmann::json& file,
                                               const std::string& where) {
  ASSIGN_OR_RETURN(nlohmann::json merged, MergeExtended(tracks_dir, {"", where, file}));
  return ConfigOfProfile(std::move(merged), track, profile, where);
}

absl::StatusOr<TrackProfiles> LoadProfiles(const std::string& tracks_dir, const std::string& track) {
  const std::string where = absl::StrCat(tracks_dir, "/", track, ".json");
  ASSIGN_OR_RETURN(const nlohmann::json merged, ReadExtended(tracks_dir, track));
  ASSIGN_OR_RETURN(TrackConfig by_default, ConfigOfProfile(merged, track, "", where));
  ASSIGN_OR_RETURN(const nlohmann::json profiles, ReadProfiles(merged, where));
  TrackProfiles loaded;
  loaded.default_profile = by_default.profile;
  loaded.configs[loaded.default_profile] = std::move(by_default);
  for (const std::string& profile : KeysOf(profiles)) {
    if (profile == loaded.default_profile) continue;
    ASSIGN_OR_RETURN(loaded.configs[profile], ConfigOfProfile(merged, track, profile, where));
  }
  return loaded;
}

absl::StatusOr<std::vector<std::string>> ListTracks(const std::string& tracks_dir) {
  std::error_code error;
  std::vector<std::string> names;
  for (fs::directory_iterator it(tracks_dir, error), end; !error && it != end;
       it.increment(error)) {
    const fs::path& path = it->path();
    if (path.extension() == ".json" && IsTrackName(path.stem().string())) {
      names.push_back(path.stem().string());
    }
  }
  if (error) {
    return absl::NotFoundError(
        absl::StrCat(tracks_dir, ": the folder of track configs can't be read: ", error.message()));
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace myograde
