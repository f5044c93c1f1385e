#include "protocol/lease/track_config.h"

#include <algorithm>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/tracks/registry.h"

namespace myograde {
namespace {

// Of the configs that this build reads: which keys they have and what they mean.
constexpr int64_t kTrackConfigForm = 2;
constexpr double kDay = 86400;
constexpr int64_t kMiB = int64_t{1} << 20;
constexpr int64_t kTiB = int64_t{1} << 40;

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
  RETURN_IF_ERROR(reader.Finish());
  return b;
}

absl::StatusOr<std::vector<uint64_t>> SeedRange(const nlohmann::json& json,
                                                const std::string& where) {
  ConfigReader reader(json, where);
  const int64_t first = reader.Integer("first", 0, INT64_MAX - kMaxEpisodes);
  const int64_t count = reader.Integer("count", 1, kMaxEpisodes);
  RETURN_IF_ERROR(reader.Finish());
  std::vector<uint64_t> seeds;
  for (int64_t i = 0; i < count; ++i) seeds.push_back(static_cast<uint64_t>(first + i));
  return seeds;
}

std::string ReadPolicySeedSecret(ConfigReader& reader) {
  constexpr char kKey[] = "policy_seed_secret";
  constexpr size_t kMaxBytes = 200;
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

// Parses what was made of `config`, and keeps what the effective config does not say.
absl::StatusOr<TrackConfig> ParseChanged(const nlohmann::json& effective,
                                         const TrackConfig& config) {
  absl::StatusOr<TrackConfig> changed = ParseTrackConfig(effective, config.id);
  if (changed.ok()) changed->extra_observations = config.extra_observations;
  return changed;
}

}  // namespace

bool IsTrackName(std::string_view name) {
  const auto good = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  };
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), good);
}

absl::Status CheckTrackName(const std::string& what, const std::string& name) {
  if (IsTrackName(name)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", name.substr(0, 80), "\" is not a name of a ", what,
                   ": use 1 to 64 of the characters a-z, 0-9 and \"-\""));
}

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
          absl::StrCat(where, ": the seed ", seed, " appears twice; each may be there once"));
    }
    seeds.push_back(seed);
  }
  return seeds;
}

absl::StatusOr<TrackConfig> ParseTrackConfig(const nlohmann::json& effective,
                                             const std::string& where) {
  ConfigReader reader(effective, where);
  reader.Integer("form", kTrackConfigForm, kTrackConfigForm);
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
  config.policy_seed_secret = ReadPolicySeedSecret(reader);
  ReadPhase(reader, config);
  RETURN_IF_ERROR(reader.Finish());
  for (const std::string& name : {config.id, config.profile}) {
    if (absl::Status status = CheckTrackName("track config or profile", name); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(where, ": ", status.message()));
    }
  }

  ASSIGN_OR_RETURN(config.budgets, ParseBudgets(budgets, where + ": budgets"));
  ASSIGN_OR_RETURN(config.seeds, ParseSeeds(effective["seeds"], where + ": seeds"));

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
  return ParseChanged(effective, config);
}

bool ShowsExtraObservations(bool asked, bool adapted, const TrackConfig& config) {
  return asked || (adapted && config.extra_observations);
}

absl::Status CheckExtraObservations(bool asked, const TrackConfig& config) {
  if (!asked || config.extra_observations) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "policy.json asks for \"extra_observations\", which the profile \"", config.profile,
      "\" of track \"", config.id, "\" does not allow; take the key out, or choose a profile that "
      "does"));
}

absl::StatusOr<TrackConfig> WithPhase(const TrackConfig& config, const nlohmann::json& keys) {
  nlohmann::json effective = config.effective;
  effective.merge_patch(keys);
  return ParseChanged(effective, config);
}

}  // namespace myograde
