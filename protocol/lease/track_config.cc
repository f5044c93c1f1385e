#include "protocol/lease/track_config.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/track_config_forms.h"
#include "protocol/tracks/registry.h"

namespace myograde {
namespace {

namespace fs = std::filesystem;

constexpr double kDay = 86400;
constexpr int64_t kMiB = int64_t{1} << 20;
constexpr int64_t kTiB = int64_t{1} << 40;

// With comments in it, a config's hash would depend on their wording.
void RemoveComments(nlohmann::json& value) {
  if (value.is_object()) {
    for (auto it = value.begin(); it != value.end();) {
      it = it.key().starts_with("//") ? value.erase(it) : std::next(it);
    }
  }
  if (value.is_structured()) {
    for (nlohmann::json& child : value) RemoveComments(child);
  }
}

// Equal seeds are written equally: a run of consecutive seeds as first and count.
nlohmann::json SeedsToJson(const std::vector<uint64_t>& seeds) {
  for (size_t i = 1; i < seeds.size(); ++i) {
    if (seeds[i] != seeds[0] + i) return seeds;
  }
  return {{"first", seeds[0]}, {"count", seeds.size()}};
}

absl::StatusOr<Budgets> ParseBudgets(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  Budgets b;
  b.startup_s = reader.Number("startup_s", {0.01, 3600});
  b.startup_wall_s = reader.Number("startup_wall_s", {0.01, kDay});
  b.step_s = reader.Number("step_s", {0.0001, 600});
  b.overtime_s = reader.Number("overtime_s", {0.0001, kDay});
  b.wall_factor = reader.Number("wall_factor", {1, 1000});
  b.lease_cpu_s = reader.Number("lease_cpu_s", {0.01, 30 * kDay});
  b.lease_wall_s = reader.Number("lease_wall_s", {0.01, 60 * kDay});
  b.lease_idle_s = reader.Number("lease_idle_s", {0.01, 60 * kDay});
  b.memory_bytes = reader.Integer("memory_bytes", 16 * kMiB, kTiB);
  b.cpus = reader.Number("cpus", {0.1, 256});
  b.tasks = reader.Integer("tasks", 4, 32768);
  b.scratch_bytes = reader.Integer("scratch_bytes", kMiB, kTiB);
  b.scratch_files = reader.Integer("scratch_files", 16, 10'000'000);
  b.output_bytes = reader.Integer("output_bytes", 4096, 1024 * kMiB);
  b.open_files = reader.Integer("open_files", 16, 1'000'000);
  b.stray_messages = reader.Integer("stray_messages", 1, 1'000'000'000);
  b.wrong_answers = reader.Integer("wrong_answers", 1, 1'000'000'000);
  b.restarts = reader.Integer("restarts", 1, 1000);
  b.submission_bytes = reader.Integer("submission_bytes", 4096, kTiB);
  b.submission_files = reader.Integer("submission_files", 1, 10'000'000);
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  return b;
}

absl::StatusOr<std::vector<uint64_t>> SeedRange(const nlohmann::json& json,
                                                const std::string& where) {
  ConfigReader reader(json, where);
  const int64_t first = reader.Integer("first", 0, INT64_MAX - kMaxEpisodes);
  const int64_t count = reader.Integer("count", 1, kMaxEpisodes);
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  std::vector<uint64_t> seeds;
  for (int64_t i = 0; i < count; ++i) seeds.push_back(static_cast<uint64_t>(first + i));
  return seeds;
}

absl::Status CheckName(const std::string& what, const std::string& name) {
  if (IsTrackName(name)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", name.substr(0, 80), "\" is no name of a ", what,
                   ": use 1 to 64 of the characters a-z, 0-9 and \"-\""));
}

constexpr char kPracticeSeeds[] = "practice_seeds";

// A list of practice seeds belongs to the list of seeds that it was chosen beside: other seeds
// leave it behind.
void MergeOver(nlohmann::json& base, const nlohmann::json& patch) {
  if (patch.contains("seeds") && !patch.contains(kPracticeSeeds)) base.erase(kPracticeSeeds);
  base.merge_patch(patch);
}

// A config file merged over everything that it extends.
absl::StatusOr<nlohmann::json> ReadExtended(const std::string& tracks_dir,
                                            const std::string& track) {
  std::vector<std::pair<std::string, nlohmann::json>> chain;  // the requested one first
  for (std::string name = track; !name.empty();) {
    if (absl::Status status = CheckName("track config", name); !status.ok()) return status;
    for (const auto& [seen, unused] : chain) {
      if (seen != name) continue;
      return absl::InvalidArgumentError(absl::StrCat(
          tracks_dir, "/", chain.back().first, ".json: \"extends\" leads back to \"", name,
          "\"; let the chain of configs end at one that extends nothing"));
    }
    const std::string path = absl::StrCat(tracks_dir, "/", name, ".json");
    std::error_code error;
    if (!fs::exists(path, error)) {
      const absl::StatusOr<std::vector<std::string>> known = ListTracks(tracks_dir);
      return absl::NotFoundError(absl::StrCat(
          "no track config \"", name, "\" in ", tracks_dir,
          chain.empty() ? "" : absl::StrCat(", which ", chain.back().first, ".json extends"),
          known.ok() ? absl::StrCat("; there are: ", absl::StrJoin(*known, ", ")) : ""));
    }
    absl::StatusOr<nlohmann::json> json = ReadJsonFile(path);
    if (!json.ok()) return json.status();
    if (!json->is_object()) {
      return absl::InvalidArgumentError(absl::StrCat(path, ": must hold a JSON object"));
    }
    std::string next;
    if (json->contains("extends")) {
      if (!(*json)["extends"].is_string() || (*json)["extends"] == "") {
        return absl::InvalidArgumentError(
            absl::StrCat(path, ": \"extends\" must be the name of another track config"));
      }
      next = (*json)["extends"].get<std::string>();
      json->erase("extends");
    }
    chain.emplace_back(name, *std::move(json));
    name = next;
  }
  nlohmann::json merged = nlohmann::json::object();
  for (auto it = chain.rbegin(); it != chain.rend(); ++it) {
    // Keys of one form merged over those of another would mean neither.
    if (it != chain.rbegin() && it->second.contains("form")) {
      const nlohmann::json base = merged.value("form", nlohmann::json(1));
      if (it->second["form"] != base) {
        return absl::InvalidArgumentError(absl::StrCat(
            tracks_dir, "/", it->first, ".json: \"form\" is ", it->second["form"].dump(),
            ", and what it extends is of form ", base.dump(),
            "; leave the key out, and write the file in the keys of what it extends"));
      }
    }
    MergeOver(merged, it->second);
  }
  return merged;
}

// The merged file's profiles, checked to be an object of objects with valid names.
absl::StatusOr<nlohmann::json> ProfilesOf(const nlohmann::json& merged, const std::string& where) {
  const auto it = merged.find("profiles");
  if (it == merged.end() || !it->is_object() || it->empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": \"profiles\" must be an object with at least one profile"));
  }
  nlohmann::json profiles = *it;
  RemoveComments(profiles);
  static const std::set<std::string> kMayChange = {
      "episodes_per_lease", "seeds", "practice_seeds", "policy_seed_secret", "budgets", "rules",
      "scoring"};
  for (const auto& [name, patch] : profiles.items()) {
    const std::string place = absl::StrCat(where, ": profile \"", name, "\"");
    if (absl::Status status = CheckName("profile", name); !status.ok()) {
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

// The secret of the policy seeds. Only the upgrade of a form-1 config sets null; a config that has
// the key itself is of a form that knows it.
std::optional<std::string> PolicySeedSecretOf(const nlohmann::json& effective,
                                              ConfigReader& reader) {
  constexpr char kKey[] = "policy_seed_secret";
  constexpr size_t kMaxBytes = 200;
  if (effective.contains(kKey) && effective.value("form", 1) == 1) {
    reader.Fail(kKey, "is no key of form 1; write \"form\": 2 beside it");
  }
  if (!effective.contains(kKey) && reader.Has(kKey)) {
    reader.Ignore(kKey);
    return std::nullopt;
  }
  std::string secret = reader.String(kKey);
  if (secret.empty() || secret.size() > kMaxBytes) {
    reader.Fail(kKey, absl::StrCat("must have 1 to ", kMaxBytes, " bytes"));
  }
  return secret;
}

// Only configs of a challenge's phases have these two.
void ReadPhase(ConfigReader& reader, TrackConfig& config) {
  constexpr size_t kSaltDigits = 64;
  if (reader.Has("phase")) {
    config.phase = reader.String("phase");
    if (!IsTrackName(config.phase)) reader.Fail("phase", "must be a name of a-z, 0-9 and \"-\"");
  }
  if (reader.Has("seed_salt")) {
    config.seed_salt = reader.String("seed_salt");
    if (config.seed_salt.size() != kSaltDigits ||
        config.seed_salt.find_first_not_of("0123456789abcdef") != std::string::npos) {
      reader.Fail("seed_salt", "must be 64 hexadecimal digits");
    }
  }
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

}  // namespace

bool IsTrackName(std::string_view name) {
  const auto good = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  };
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), good);
}

absl::StatusOr<std::vector<uint64_t>> ParseSeeds(const nlohmann::json& json,
                                                 const std::string& where) {
  if (json.is_object()) return SeedRange(json, where);
  if (!json.is_array()) {
    return absl::InvalidArgumentError(absl::StrCat(
        where, ": must be {\"first\": N, \"count\": K} or a list of whole numbers"));
  }
  if (json.empty() || json.size() > static_cast<size_t>(kMaxEpisodes)) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": has ", json.size(), " seeds, must have 1 to ", kMaxEpisodes));
  }
  std::vector<uint64_t> seeds;
  std::set<uint64_t> seen;
  for (const nlohmann::json& entry : json) {
    // The parser stores a non-negative integer as unsigned; code that builds one from an int64_t
    // stores it as signed.
    const bool whole = entry.is_number_integer() &&
                       (entry.is_number_unsigned() || entry.get<int64_t>() >= 0) &&
                       entry.get<uint64_t>() <= static_cast<uint64_t>(INT64_MAX);
    if (!whole) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": entry ", seeds.size(), " is ", entry.dump().substr(0, 40),
                       ", must be a whole number from 0 to ", INT64_MAX));
    }
    const uint64_t seed = entry.get<uint64_t>();
    if (!seen.insert(seed).second) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": the seed ", seed, " is there twice; each may be there once"));
    }
    seeds.push_back(seed);
  }
  return seeds;
}

absl::StatusOr<TrackConfig> ParseTrackConfig(const nlohmann::json& effective,
                                             const std::string& where) {
  absl::StatusOr<nlohmann::json> today = UpgradeTrackConfig(effective, where);
  if (!today.ok()) return today.status();
  ConfigReader reader(*today, where);
  reader.Ignore("form");
  TrackConfig config;
  config.id = reader.String("id");
  config.kind = FindTrack(reader.Choice("track", TrackNames()));
  config.profile = reader.String("profile");
  config.episodes_per_lease = reader.Integer("episodes_per_lease", 1, kMaxEpisodes);
  config.rules = reader.Object("rules");
  config.scoring = reader.Object("scoring");
  const nlohmann::json& budgets = reader.Object("budgets");
  if (!reader.Has("seeds")) reader.Fail("seeds", "is missing");
  reader.Ignore("seeds");
  config.policy_seed_secret = PolicySeedSecretOf(effective, reader);
  ReadPhase(reader, config);
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  for (const std::string& name : {config.id, config.profile}) {
    if (absl::Status status = CheckName("track config or profile", name); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(where, ": ", status.message()));
    }
  }

  absl::StatusOr<Budgets> parsed_budgets = ParseBudgets(budgets, where + ": budgets");
  if (!parsed_budgets.ok()) return parsed_budgets.status();
  config.budgets = *parsed_budgets;
  absl::StatusOr<std::vector<uint64_t>> seeds = ParseSeeds(effective["seeds"], where + ": seeds");
  if (!seeds.ok()) return seeds.status();
  config.seeds = *std::move(seeds);

  config.effective = effective;
  RemoveComments(config.effective);
  config.effective["seeds"] = SeedsToJson(config.seeds);
  RemoveComments(config.rules);
  RemoveComments(config.scoring);
  config.hash = Sha256Hex(CanonicalJson(config.effective));
  return config;
}

absl::StatusOr<TrackConfig> WithSeeds(const TrackConfig& config,
                                      const std::vector<uint64_t>& seeds) {
  nlohmann::json effective = config.effective;
  effective["seeds"] = seeds;
  return ParseTrackConfig(effective, config.id);
}

absl::StatusOr<TrackConfig> WithPhase(const TrackConfig& config, const nlohmann::json& keys) {
  nlohmann::json effective = config.effective;
  effective.merge_patch(keys);
  return ParseTrackConfig(effective, config.id);
}

absl::StatusOr<TrackConfig> LoadTrackConfig(const std::string& tracks_dir,
                                            const std::string& track,
                                            const std::string& profile) {
  absl::StatusOr<nlohmann::json> merged = ReadExtended(tracks_dir, track);
  if (!merged.ok()) return merged.status();
  const std::string where = absl::StrCat(tracks_dir, "/", track, ".json");
  absl::StatusOr<nlohmann::json> profiles = ProfilesOf(*merged, where);
  if (!profiles.ok()) return profiles.status();
  std::string wanted = profile;
  if (wanted.empty()) {
    const auto it = merged->find("default_profile");
    if (it == merged->end() || !it->is_string() || !profiles->contains(*it)) {
      return absl::InvalidArgumentError(absl::StrCat(
          where, ": \"default_profile\" must be one of: ", absl::StrJoin(KeysOf(*profiles), ", ")));
    }
    wanted = it->get<std::string>();
  }
  if (!profiles->contains(wanted)) {
    return absl::NotFoundError(
        absl::StrCat("track \"", track, "\" has no rules profile \"", wanted.substr(0, 80),
                     "\"; it has: ", absl::StrJoin(KeysOf(*profiles), ", ")));
  }
  for (const char* key : {"id", "profile", "phase", "seed_salt"}) {
    if (!merged->contains(key)) continue;
    return absl::InvalidArgumentError(absl::StrCat(
        where, ": \"", key, "\" is given by the file's name and the caller; remove it"));
  }
  nlohmann::json effective = *std::move(merged);
  effective.erase("profiles");
  effective.erase("default_profile");
  MergeOver(effective, (*profiles)[wanted]);
  effective["id"] = track;
  effective["profile"] = wanted;
  const nlohmann::json practice = effective.value(kPracticeSeeds, nlohmann::json());
  effective.erase(kPracticeSeeds);
  const std::string place = absl::StrCat(where, " (profile ", wanted, ")");
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(effective, place);
  if (!config.ok() || practice.is_null()) return config;
  absl::StatusOr<std::vector<uint64_t>> seeds = PracticeSeeds(practice, config->seeds, place);
  if (!seeds.ok()) return seeds.status();
  config->practice_seeds = *std::move(seeds);
  return config;
}

absl::StatusOr<std::vector<std::string>> ListProfiles(const std::string& tracks_dir,
                                                      const std::string& track) {
  absl::StatusOr<nlohmann::json> merged = ReadExtended(tracks_dir, track);
  if (!merged.ok()) return merged.status();
  absl::StatusOr<nlohmann::json> profiles =
      ProfilesOf(*merged, absl::StrCat(tracks_dir, "/", track, ".json"));
  if (!profiles.ok()) return profiles.status();
  return KeysOf(*profiles);
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
