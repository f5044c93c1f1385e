#include "server/api/rejudge_plan.h"

#include <algorithm>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/api/requests.h"
#include "server/engine/stored.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kWhereSent[] = "the new config";
// A submission's number.
constexpr int64_t kMostId = 999'999'999'999'999'999;

std::string ReadBoardName(ConfigReader& reader, const char* key) {
  if (!reader.Has(key)) return "";
  std::string name = reader.String(key);
  if (!IsTrackName(name)) {
    reader.Fail(key, "must be a name of 1 to 64 of the characters a-z, 0-9 and \"-\"");
  }
  return name;
}

// The keys that a phase gives to the config that it plays (PhaseTrack of challenge/phases.h). All of
// them are in the config that it plays now.
Json KeysOfPhase(const ApiContext& context, const TrackConfig& live) {
  Json keys = {{"phase", live.phase}};
  const PhaseConfig* phase = context.phases.ConfigOf(live.phase);
  const auto keep = [&](const char* key) {
    if (live.effective.contains(key)) keys[key] = live.effective[key];
  };
  const bool hidden = !live.seed_salt.empty();
  if (hidden || phase == nullptr || !phase->seeds.empty()) keep("seeds");
  if (hidden) {
    keep("policy_seed_secret");
    keep("seed_salt");
  }
  // Nobody knows any more whether a phase without a file had a rule of its own.
  if (phase == nullptr || phase->entry.has_value()) {
    keys["scoring"] = {{"team", live.scoring.value("team", "best")}};
  }
  return keys;
}

absl::Status CheckFits(const TrackConfig& live, const TrackConfig& config) {
  if (config.kind != live.kind) {
    return absl::InvalidArgumentError(absl::StrCat(
        kWhereSent, " is of the environment \"", std::string(config.kind->name), "\", but track \"",
        live.id, "\" is of \"", std::string(live.kind->name),
        "\"; give one that extends this board's track"));
  }
  if (config.seeds.size() != live.seeds.size()) {
    return absl::InvalidArgumentError(absl::StrCat(
        kWhereSent, " has ", config.seeds.size(), " seeds and the board has ", live.seeds.size(),
        "; a board keeps the number of its episodes"));
  }
  return absl::OkStatus();
}

absl::StatusOr<TrackPtr> NewTrack(const ApiContext& context, const TrackConfig& live,
                                  const Json& file) {
  absl::StatusOr<TrackConfig> config = ResolveTrackConfig(
      context.tracks_dir, live.id, live.profile, file, kWhereSent);
  if (!config.ok()) return config.status();
  // Checked first: another environment lacks most of this one's keys.
  RETURN_IF_ERROR(config->kind == live.kind ? absl::OkStatus() : CheckFits(live, *config));
  if (!live.phase.empty()) {
    config = WithPhase(*config, KeysOfPhase(context, live));
    if (!config.ok()) return config.status();
  }
  RETURN_IF_ERROR(CheckFits(live, *config));
  return MakeTrack(*std::move(config));
}

// nullptr: one of them lacks it. What only one has is told key by key, and a list as one value.
void AddDiffering(const Json* from, const Json* to, const std::string& at,
                  std::set<std::string>& keys) {
  const auto is_part = [](const Json* value) { return value != nullptr && value->is_object(); };
  const bool parts = (is_part(from) || from == nullptr) && (is_part(to) || to == nullptr);
  if (!parts) {
    if (from == nullptr || to == nullptr || *from != *to) keys.insert(at);
    return;
  }
  std::set<std::string> names;
  for (const Json* side : {from, to}) {
    if (side == nullptr) continue;
    for (const auto& [name, value] : side->items()) names.insert(name);
  }
  const auto entry = [](const Json* side, const std::string& name) -> const Json* {
    return side != nullptr && side->contains(name) ? &side->at(name) : nullptr;
  };
  for (const std::string& name : names) {
    AddDiffering(entry(from, name), entry(to, name), absl::StrCat(at, "/", name), keys);
  }
}

}  // namespace

absl::StatusOr<RejudgeRequest> ParseRejudge(const Json& body) {
  ConfigReader reader(body, "request");
  RejudgeRequest request;
  request.phase = ReadBoardName(reader, "phase");
  request.track = ReadBoardName(reader, "track");
  request.profile = ReadBoardName(reader, "profile");
  if (request.phase.empty() == request.track.empty()) {
    reader.Fail("phase", "or \"track\" must be there, and not both: which board is rejudged");
  } else if (!request.phase.empty() && !request.profile.empty()) {
    reader.Fail("profile", "is of a track's own board; a phase has one profile");
  }
  if (reader.Has("config")) request.config = reader.Object("config");
  if (reader.Has("method")) {
    request.method =
        ParseRejudgeMethod(reader.Choice("method", {"auto", "facts", "play"})).value_or(
            RejudgeMethod::kAuto);
  }
  if (reader.Has("repeats")) request.repeats = reader.Integer("repeats", 1, kMostRepeats);
  request.reason = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return request;
}

absl::StatusOr<ApplyRequest> ParseApply(const Json& body) {
  ConfigReader reader(body, "request");
  ApplyRequest request;
  request.reason = ReadReason(reader);
  if (reader.Has("without")) {
    for (const Json& id : reader.Array("without")) {
      const bool good = id.is_number_integer() && id >= 1 && id <= kMostId;
      if (good) {
        request.without.push_back(id.get<int64_t>());
      } else {
        reader.Fail("without", "must list numbers of submissions");
      }
    }
  }
  RETURN_IF_ERROR(reader.Finish());
  std::sort(request.without.begin(), request.without.end());
  const auto twice = std::unique(request.without.begin(), request.without.end());
  request.without.erase(twice, request.without.end());
  return request;
}

absl::StatusOr<TrackPtr> TrackInForce(Reader& reader, const ApiContext& context,
                                      const std::string& phase, const std::string& track,
                                      const std::string& profile) {
  if (phase.empty()) return context.tracks.Find(track, profile);
  const absl::StatusOr<PhasePtr> found = context.phases.Find(phase);
  if (found.ok()) return (*found)->track;
  // One that no file describes any more.
  const std::string hash =
      context.phases.ConfigOf(phase) == nullptr ? reader.ConfigOfPhase(phase) : "";
  if (hash.empty()) return found.status();
  return StoredTrack(reader, hash);
}

absl::StatusOr<NewRejudge> MakeRejudge(Reader& reader, const ApiContext& context,
                                       const RejudgeRequest& request) {
  ASSIGN_OR_RETURN(const TrackPtr live,
                   TrackInForce(reader, context, request.phase, request.track, request.profile));
  const TrackConfig& from = live->config;
  absl::StatusOr<TrackPtr> next = live;
  if (request.config.has_value()) next = NewTrack(context, from, *request.config);
  if (!next.ok()) return next.status();
  const TrackConfig& to = (*next)->config;
  NewRejudge rejudge;
  rejudge.phase = from.phase;
  rejudge.track = from.id;
  rejudge.profile = from.profile;
  rejudge.from_config = from.hash;
  rejudge.from_config_json = CanonicalJson(from.effective);
  rejudge.to_config = to.hash;
  rejudge.to_config_json = CanonicalJson(to.effective);
  rejudge.seeds_json = CanonicalJson(Json(to.seeds));
  rejudge.seeds = Sha256Hex(rejudge.seeds_json);
  rejudge.seed_count = static_cast<int64_t>(to.seeds.size());
  rejudge.method = request.method;
  rejudge.repeats = request.repeats;
  rejudge.why = request.reason;
  return rejudge;
}

std::vector<std::string> DifferingKeys(const Json& from, const Json& to) {
  std::set<std::string> keys;
  AddDiffering(&from, &to, "", keys);
  return {keys.begin(), keys.end()};
}

}  // namespace myograde::server
