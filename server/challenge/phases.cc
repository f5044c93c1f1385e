#include "server/challenge/phases.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <set>
#include <tuple>
#include <utility>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/seed_commitment.h"
#include "protocol/lease/track_config.h"
#include "server/base/error_code.h"
#include "server/challenge/markdown.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxChallengeBytes = 4u << 20;
constexpr size_t kMaxTextBytes = 64u << 10;
constexpr size_t kMaxLogoBytes = 256u << 10;
constexpr std::string_view kPngSignature = "\x89PNG\r\n\x1a\n";
constexpr std::array<std::string_view, 4> kStateNames = {"upcoming", "open", "paused", "closed"};

std::string CantBeRead(const std::string& dir, const std::error_code& error) {
  return absl::StrCat(dir, ": the folder of challenges can't be read: ", error.message());
}

// The challenge files of a folder, sorted. Hidden files are an editor's.
std::vector<fs::path> ChallengeFiles(const std::string& dir, std::vector<std::string>& mistakes) {
  std::vector<fs::path> paths;
  std::error_code error;
  if (!fs::exists(dir, error)) {
    if (error) mistakes.push_back(CantBeRead(dir, error));
    return paths;
  }
  for (fs::directory_iterator it(dir, error), end; !error && it != end; it.increment(error)) {
    const std::string file = it->path().filename().string();
    if (file.ends_with(".json") && !file.starts_with('.')) paths.push_back(it->path());
  }
  if (error) mistakes.push_back(CantBeRead(dir, error));
  std::sort(paths.begin(), paths.end());
  return paths;
}

bool Fits(const PhaseConfig& phase, const PhaseQuery& query) {
  return phase.track == query.track && (query.profile.empty() || phase.profile == query.profile);
}

// None of the phases that fit is open.
absl::Status NoneOpen(const std::vector<PhasePtr>& fitting, const PhaseQuery& query,
                      absl::Time now) {
  std::string what = absl::StrCat(
      "no phase of track \"", query.track, "\"",
      query.profile.empty() ? "" : absl::StrCat(" in the profile \"", query.profile, "\""),
      " is open");
  // They are in order of opening.
  const auto next = std::find_if(fitting.begin(), fitting.end(),
                                 [&](const PhasePtr& phase) { return now < phase->config.opens; });
  if (next != fitting.end()) {
    absl::StrAppend(&what, "; \"", (*next)->config.name, "\" opens at ",
                    UtcText((*next)->config.opens));
  } else {
    absl::StrAppend(&what, ", and none opens later");
  }
  absl::StrAppend(&what, "; give \"episodes\" to practise");
  return WithErrorCode(absl::FailedPreconditionError(what), "phase_closed");
}

// What the files say of each board.
std::vector<TrackPtr> TracksOfFiles(const Tracks& tracks, const Phases& phases) {
  std::vector<TrackPtr> found;
  for (const auto& [name, entry] : tracks.entries()) {
    for (const auto& [profile, track] : entry.profiles) found.push_back(track);
  }
  for (const PhasePtr& phase : phases.entries()) found.push_back(phase->track);
  return found;
}

std::string ShownBoard(const BoardName& board) {
  return board.phase.empty() ? absl::StrCat("track \"", board.track, "\" in the profile \"",
                                            board.profile, "\"")
                             : absl::StrCat("phase \"", board.phase, "\"");
}

// What the file may say without meaning anything new: what it said before the rejudges that are
// behind the newest row, and what each of them made of it.
std::set<std::string> FileConfigsBehind(const std::vector<BoardConfigRow>& rows) {
  std::set<std::string> configs;
  for (auto row = rows.rbegin(); row != rows.rend() && row->rejudge != 0; ++row) {
    configs.insert({row->config, row->from_config});
  }
  return configs;
}

}  // namespace

void ReadChallengeText(const std::string& file, ChallengeConfig& challenge,
                       std::vector<std::string>& mistakes) {
  const auto read = [&](const char* extension, size_t most) {
    const std::string path = fs::path(file).replace_extension(extension).string();
    std::error_code error;
    if (!fs::exists(path, error)) return std::string();
    absl::StatusOr<std::string> bytes = ReadFile(path, most);
    if (!bytes.ok()) mistakes.emplace_back(bytes.status().message());
    return bytes.ok() ? *std::move(bytes) : std::string();
  };
  challenge.text = MarkdownTree(read(".md", kMaxTextBytes));
  challenge.logo = read(".png", kMaxLogoBytes);
  if (!challenge.logo.empty() && !challenge.logo.starts_with(kPngSignature)) {
    mistakes.push_back(absl::StrCat(fs::path(file).replace_extension(".png").string(),
                                    ": the challenge's logo is not a PNG; convert it to one"));
  }
}

std::vector<ChallengeConfig> ReadChallenges(const std::string& dir,
                                            std::vector<std::string>& mistakes) {
  std::vector<ChallengeConfig> challenges;
  for (const fs::path& path : ChallengeFiles(dir, mistakes)) {
    const std::string name = path.stem().string();
    if (!IsTrackName(name)) {
      mistakes.push_back(absl::StrCat(path.string(), ": the file's name is that of the challenge; "
                                      "use 1 to 64 of the characters a-z, 0-9 and \"-\""));
      continue;
    }
    const absl::StatusOr<nlohmann::json> json = ReadJsonFile(path.string(), kMaxChallengeBytes);
    if (!json.ok()) {
      mistakes.emplace_back(json.status().message());
      continue;
    }
    challenges.push_back(ReadChallenge(*json, name, path.string(), mistakes));
    ReadChallengeText(path.string(), challenges.back(), mistakes);
  }
  return challenges;
}

absl::StatusOr<TrackPtr> PhaseTrack(const PhaseConfig& phase, const Track& track,
                                    const std::string& secret) {
  nlohmann::json keys = {{"phase", phase.name}};
  if (phase.entry.has_value()) keys["scoring"] = {{"team", TeamRuleName(*phase.entry)}};
  if (!phase.seeds.empty()) keys["seeds"] = phase.seeds;
  if (phase.committed != 0) {
    PhaseSecrets secrets = SecretsOfPhase(secret, phase.name);
    keys["seeds"] = DeriveSeeds(secret, phase.name, phase.committed);
    keys["policy_seed_secret"] = std::move(secrets.policy_seed_secret);
    keys["seed_salt"] = std::move(secrets.seed_salt);
  }
  ASSIGN_OR_RETURN(TrackConfig config, WithPhase(track.config, keys));
  return MakeTrack(std::move(config));
}

nlohmann::json KeysOfPhase(const PhaseConfig* phase, const TrackConfig& live) {
  nlohmann::json keys = {{"phase", live.phase}};
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

absl::StatusOr<Phases> Phases::Make(std::vector<ChallengeConfig> challenges, const Tracks& tracks,
                                    const SecretOfPhase& secret_of) {
  Phases phases;
  std::vector<PhasePtr> entries;
  phases.challenges_ = std::move(challenges);
  for (const ChallengeConfig& challenge : phases.challenges_) {
    for (const PhaseConfig& config : challenge.phases) {
      ASSIGN_OR_RETURN(const TrackPtr track, tracks.Find(config.track, config.profile));
      absl::StatusOr<std::string> secret = "";
      if (config.committed != 0) secret = secret_of(config);
      if (!secret.ok()) {
        phases.unusable_.emplace(config.name, secret.status());
        continue;
      }
      ASSIGN_OR_RETURN(TrackPtr own, PhaseTrack(config, *track, *secret));
      entries.push_back(std::make_shared<const Phase>(
          Phase{config, std::move(own),
                secret->empty() ? "" : Sha256Hex(absl::BytesToHexString(*secret))}));
    }
  }
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) {
    return std::tie(a->config.opens, a->config.name) < std::tie(b->config.opens, b->config.name);
  });
  const MutexLock lock(phases.played_->mutex);
  phases.played_->entries = std::move(entries);
  return phases;
}

absl::StatusOr<PhasePtr> Phases::Find(const std::string& name) const {
  const std::vector<PhasePtr> known_phases = entries();
  for (const PhasePtr& phase : known_phases) {
    if (phase->config.name == name) return phase;
  }
  if (const auto it = unusable_.find(name); it != unusable_.end()) return it->second;
  const std::string known = absl::StrJoin(
      known_phases, ", ",
      [](std::string* out, const PhasePtr& p) { out->append(p->config.name); });
  return WithErrorCode(
      absl::NotFoundError(absl::StrCat("there is no phase \"", name.substr(0, 80), "\"; known: ",
                                       known.empty() ? "none" : known)),
      "unknown_phase");
}

std::vector<PhasePtr> Phases::entries() const {
  const MutexLock lock(played_->mutex);
  return played_->entries;
}

absl::Status Phases::Replace(const TrackPtr& track) {
  const TrackConfig& config = track->config;
  const MutexLock lock(played_->mutex);
  for (PhasePtr& phase : played_->entries) {
    if (phase->config.name != config.phase) continue;
    const TrackConfig& before = phase->track->config;
    if (before.id != config.id || before.profile != config.profile || before.kind != config.kind) {
      return absl::InvalidArgumentError(
          absl::StrCat("config ", config.hash, " is of track \"", config.id, "\" in the profile \"",
                       config.profile, "\", and phase \"", config.phase, "\" is of track \"",
                       before.id, "\" in the profile \"", before.profile, "\""));
    }
    Phase changed = *phase;
    changed.track = track;
    phase = std::make_shared<const Phase>(std::move(changed));
    return absl::OkStatus();
  }
  return absl::NotFoundError(
      absl::StrCat("there is no phase \"", config.phase, "\" that could play config ", config.hash));
}

void Phases::Close(const std::string& name, const absl::Status& why) {
  const MutexLock lock(played_->mutex);
  std::erase_if(played_->entries,
                [&](const PhasePtr& phase) { return phase->config.name == name; });
  unusable_.insert_or_assign(name, why);
}

const PhaseConfig* Phases::ConfigOf(const std::string& name) const {
  for (const ChallengeConfig& challenge : challenges_) {
    for (const PhaseConfig& phase : challenge.phases) {
      if (phase.name == name) return &phase;
    }
  }
  return nullptr;
}

std::string_view PhaseStateName(PhaseState state) {
  return kStateNames[static_cast<size_t>(state)];
}

PhaseStatus StatusOfPhase(const PhaseConfig& phase, const BoardState& board, absl::Time now) {
  const PhaseHistory& own = board.Phase(phase.name);
  PhaseStatus status{.pause = own.Pause(),
                     .published = own.Has(kPublishedEvent),
                     .revealed = own.Has(kRevealedEvent)};
  if (status.pause == nullptr) status.pause = board.Phase("").Pause();
  if (now < phase.opens) {
    status.state = PhaseState::kUpcoming;
  } else if (now >= phase.closes) {
    status.state = PhaseState::kClosed;
  } else {
    status.state = status.pause != nullptr ? PhaseState::kPaused : PhaseState::kOpen;
  }
  // Whoever knows the seeds can train on them, whatever the calendar says.
  if (status.revealed) status.state = PhaseState::kClosed;
  status.frozen = now >= phase.freezes && !status.published && !status.revealed;
  return status;
}

absl::StatusOr<std::vector<std::string>> CheckAgainstStore(
    std::span<const ChallengeConfig> challenges, const Transaction& reader, absl::Time now) {
  std::vector<std::string> found;
  for (const ChallengeConfig& challenge : challenges) {
    for (const PhaseConfig& phase : challenge.phases) {
      const std::string place = absl::StrCat(challenge.where, ": phase \"", phase.name, "\": ");
      const absl::Status secret = phase.committed == 0
                                      ? absl::OkStatus()
                                      : reader.phases.CheckSecret(phase.name, challenge.name);
      if (!secret.ok()) {
        found.push_back(absl::StrCat(place, secret.message()));
      } else if (phase.committed == 0 && reader.Board().HasCommitted(phase.name)) {
        found.push_back(absl::StrCat(
            place, "this store has committed to hidden seeds for it, and its file gives other ones, so nobody "
            "can check what it plays; set \"seeds\" back to {\"committed\": N}, or give the phase another "
            "name"));
      } else if (reader.Board().Phase(phase.name).Has(kRevealedEvent) && now < phase.closes) {
        found.push_back(absl::StrCat(
            place, "its seeds were revealed in this store, so it no longer accepts anything, but "
            "its times would keep it open; set \"closes_at\" back to when it closed, or give a new "
            "phase "
            "another name"));
      }
    }
  }
  return found;
}

absl::Status CheckOpen(const PhaseConfig& phase, absl::Time now) {
  if (now >= phase.opens && now < phase.closes) return absl::OkStatus();
  return WithErrorCode(
      absl::FailedPreconditionError(
          now < phase.opens
              ? absl::StrCat("phase \"", phase.name, "\" opens at ", UtcText(phase.opens),
                             "; submit then")
              : absl::StrCat("phase \"", phase.name, "\" closed at ", UtcText(phase.closes),
                             " and no longer takes anything")),
      "phase_closed");
}

bool HasPhases(const Phases& phases, const std::string& track) {
  const auto& challenges = phases.challenges();
  return std::any_of(challenges.begin(), challenges.end(), [&](const ChallengeConfig& challenge) {
    return std::any_of(challenge.phases.begin(), challenge.phases.end(),
                       [&](const PhaseConfig& phase) { return phase.track == track; });
  });
}

absl::StatusOr<PhasePtr> FindPhase(const Phases& phases, const PhaseQuery& query, absl::Time now) {
  if (!query.phase.empty()) {
    absl::StatusOr<PhasePtr> phase = phases.Find(query.phase);
    if (!phase.ok() || Fits((*phase)->config, query)) return phase;
    return absl::InvalidArgumentError(absl::StrCat("phase \"", query.phase, "\" is of track \"",
                                                   (*phase)->config.track, "\" in the profile \"",
                                                   (*phase)->config.profile, "\"; submit to that"));
  }
  std::vector<PhasePtr> fitting;
  std::vector<PhasePtr> open;
  for (const PhasePtr& phase : phases.entries()) {
    if (!Fits(phase->config, query)) continue;
    fitting.push_back(phase);
    if (CheckOpen(phase->config, now).ok()) open.push_back(phase);
  }
  if (open.size() == 1) return open.front();
  if (open.empty()) return NoneOpen(fitting, query, now);
  return absl::InvalidArgumentError(absl::StrCat(
      "track \"", query.track, "\" has ", open.size(), " open phases; name one as \"phase\": ",
      absl::StrJoin(open, ", ", [](std::string* out, const PhasePtr& phase) {
        out->append(phase->config.name);
      })));
}

absl::Status SwitchConfig(const TrackPtr& track, Tracks& tracks, Phases& phases) {
  if (track->config.phase.empty()) return tracks.Replace(track);
  const absl::Status replaced = phases.Replace(track);
  return absl::IsNotFound(replaced) ? absl::OkStatus() : replaced;
}

absl::Status SwitchConfig(const Transaction& reader, const std::string& config_hash, Tracks& tracks,
                          Phases& phases) {
  ASSIGN_OR_RETURN(const TrackPtr track, StoredTrack(reader, config_hash));
  return SwitchConfig(track, tracks, phases);
}

absl::StatusOr<Overlaid> OverlayConfigs(const Transaction& reader, Tracks& tracks, Phases& phases) {
  Overlaid overlaid;
  for (const TrackPtr& track : TracksOfFiles(tracks, phases)) {
    const TrackConfig& config = track->config;
    const std::string& hash = config.hash;
    const BoardName board = {config.phase, config.id, config.profile};
    const std::vector<BoardConfigRow>& own = reader.Board().ConfigsOf(board);
    const std::string before = reader.Board().ConfigAt(board);
    if (before.empty() || before == hash) continue;
    if (!FileConfigsBehind(own).contains(hash)) {
      overlaid.changed.push_back({board, hash, CanonicalJson(config.effective)});
      overlaid.warnings.push_back(absl::StrCat(
          ShownBoard(board), " was changed after it got submissions: they remain under its "
          "earlier config ", before, ", and not on its board"));
      continue;
    }
    const absl::Status switched = SwitchConfig(reader, before, tracks, phases);
    if (switched.ok()) {
      overlaid.notes.push_back(absl::StrCat(ShownBoard(board), " has the config ", before,
                                            " of rejudge ", own.back().rejudge,
                                            ", not that of its files, ", hash));
      continue;
    }
    if (!board.phase.empty()) {
      phases.Close(board.phase, switched);
      continue;
    }
    overlaid.errors.push_back(absl::StrCat(ShownBoard(board), " has the config of its files, "
                                           "and not the one of rejudge ", own.back().rejudge, ": ",
                                           switched.message()));
  }
  return overlaid;
}

}  // namespace myograde::server
