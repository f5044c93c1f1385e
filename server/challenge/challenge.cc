// Reading the file form.
#include "server/challenge/challenge.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "scoring/config.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr int64_t kForm = 1;
constexpr size_t kMaxTeams = 10'000;
constexpr size_t kMaxTeamBytes = 64;
// Failed tries of a team in a phase that withholds anything, unless the phase says otherwise.
constexpr int64_t kHiddenFailures = 20;
constexpr std::array kTeamRules = {"best", "last", "chosen"};

// A phase's own keys fit a server with these; whether they fit the server that has them is checked
// when it starts.
constexpr scoring::StatisticsConfig kAnyStatistics = {
    .groups = {.level = 0.5, .samples = scoring::kMostSamples, .places = 2}};

// Only the years that a stored time may have.
constexpr absl::Time kFirstTime = absl::FromUnixSeconds(946'684'800);     // 2000-01-01
constexpr absl::Time kLastTime = absl::FromUnixSeconds(253'402'214'400);  // 9999-12-31

absl::Time ReadTime(ConfigReader& reader, const char* key, absl::Time fallback) {
  if (!reader.Has(key)) return fallback;
  const std::string text = reader.String(key);
  absl::Time time;
  std::string unused;
  const bool begins = !text.empty() && std::isdigit(static_cast<unsigned char>(text.front()));
  const bool ends = begins && !std::isspace(static_cast<unsigned char>(text.back()));
  if (!ends || !absl::ParseTime(absl::RFC3339_full, text, &time, &unused)) {
    reader.Fail(key, "must be a time with a zone, as in \"2026-12-01T00:00:00Z\"");
    return fallback;
  }
  if (time < kFirstTime || time > kLastTime) {
    reader.Fail(key, "must lie in the years 2000 to 9999");
    return fallback;
  }
  return time;
}

std::string ReadTitle(ConfigReader& reader) {
  const std::string title = reader.String("title");
  if (!IsPlainText(title, kMaxTitleBytes)) {
    reader.Fail("title", absl::StrCat("must be 1 to ", kMaxTitleBytes,
                                      " bytes of text without control characters"));
  }
  return title;
}

std::string ReadName(ConfigReader& reader, const char* key) {
  const std::string name = reader.String(key);
  if (!IsTrackName(name)) {
    reader.Fail(key, "must have 1 to 64 of the characters a-z, 0-9 and \"-\"");
  }
  return name;
}

absl::Status ReadSeedsOfPhase(const nlohmann::json& json, const std::string& where,
                              PhaseConfig& phase) {
  if (json.is_object() && json.contains("committed")) {
    ConfigReader reader(json, where);
    phase.committed = reader.Integer("committed", 1, kMaxEpisodes);
    return reader.Finish();
  }
  ASSIGN_OR_RETURN(phase.seeds, ParseSeeds(json, where));
  return absl::OkStatus();
}

absl::Status ReadQuotaOfPhase(const nlohmann::json& json, const std::string& where,
                              PhaseQuota& quota) {
  ConfigReader reader(json, where);
  const auto read = [&](const char* key, std::optional<int64_t>& units) {
    if (reader.Has(key)) units = reader.Integer(key, 1, kMostUnits);
  };
  read("official_per_day", quota.official_per_day);
  read("official_total", quota.official_total);
  read("failed_per_day", quota.failed_per_day);
  read("failed_total", quota.failed_total);
  read("waiting", quota.waiting);
  if (reader.Has("same_artefact")) {
    quota.one_for_everyone = reader.Choice("same_artefact", {"team", "everyone"}) == "everyone";
  }
  for (const char* key : {"practice_per_day", "practice_total"}) {
    if (!reader.Has(key)) continue;
    reader.Fail(key, "is not a key of a phase, as practice belongs to the track; set it in server.json");
  }
  return reader.Finish();
}

absl::Status ReadShown(const nlohmann::json& json, const std::string& where, Visibility& shown) {
  ConfigReader reader(json, where);
  const auto read = [&](const char* key, bool& value) {
    if (reader.Has(key)) value = reader.Boolean(key);
  };
  read("aggregate", shown.aggregate);
  read("outcomes", shown.outcomes);
  read("metrics", shown.metrics);
  read("logs", shown.logs);
  read("output", shown.output);
  return reader.Finish();
}

// The names are not looked up, as a team may be created later.
std::vector<std::string> ReadTeams(ConfigReader& reader) {
  if (!reader.Has("teams")) return {};
  std::vector<std::string> teams = reader.Strings("teams");
  const bool named = std::all_of(teams.begin(), teams.end(), [](const std::string& team) {
    return IsPlainText(team, kMaxTeamBytes);
  });
  if (teams.empty() || teams.size() > kMaxTeams || !named) {
    reader.Fail("teams", absl::StrCat("must be 1 to ", kMaxTeams, " names of teams; leave the key "
                                      "out if every team may submit"));
  }
  return teams;
}

absl::StatusOr<PhaseConfig> ParsePhase(const nlohmann::json& json, const std::string& where) {
  static const nlohmann::json kNone = nlohmann::json::object();
  ConfigReader reader(json, where);
  PhaseConfig phase;
  phase.name = ReadName(reader, "name");
  phase.title = ReadTitle(reader);
  phase.track = ReadName(reader, "track");
  phase.profile = ReadName(reader, "profile");
  phase.opens = ReadTime(reader, "opens_at", phase.opens);
  phase.closes = ReadTime(reader, "closes_at", phase.closes);
  phase.freezes = ReadTime(reader, "freeze_at", phase.freezes);
  if (reader.Has("entry")) phase.entry = scoring::ReadTeam(reader, "entry");
  phase.teams = ReadTeams(reader);
  const nlohmann::json& quota = reader.Has("quota") ? reader.Object("quota") : kNone;
  const nlohmann::json& shown = reader.Has("show") ? reader.Object("show") : kNone;
  if (reader.Has("public_replay")) phase.public_replay = reader.Boolean("public_replay");
  if (reader.Has("statistics")) phase.statistics = reader.Object("statistics");
  const bool has_seeds = reader.Has("seeds");
  reader.Ignore("seeds");  // ReadSeedsOfPhase reads them
  RETURN_IF_ERROR(reader.Finish());
  if (has_seeds) RETURN_IF_ERROR(ReadSeedsOfPhase(json["seeds"], where + ": seeds", phase));
  // A log holds the seed of its episode.
  phase.shown.logs = phase.committed == 0;
  phase.shown.seeds = phase.committed == 0;
  RETURN_IF_ERROR(ReadQuotaOfPhase(quota, where + ": quota", phase.quota));
  RETURN_IF_ERROR(ReadShown(shown, where + ": show", phase.shown));
  RETURN_IF_ERROR(
      scoring::ParseStatistics(phase.statistics, where + ": statistics", kAnyStatistics).status());
  return phase;
}

// How mistakes name a phase: by its name if it has one.
std::string PlaceOfPhase(const nlohmann::json& json, size_t index) {
  const auto name = json.is_object() ? json.find("name") : json.end();
  return name != json.end() && name->is_string() && IsTrackName(name->get<std::string>())
             ? absl::StrCat("phase \"", name->get<std::string>(), "\"")
             : absl::StrCat("phases[", index, "]");
}

}  // namespace

ChallengeConfig ReadChallenge(const nlohmann::json& json, const std::string& name,
                              const std::string& where, std::vector<std::string>& mistakes) {
  ChallengeConfig challenge{.name = name, .where = where, .title = "", .phases = {}};
  ConfigReader reader(json, where);
  reader.Integer("form", kForm, kForm);
  challenge.title = ReadTitle(reader);
  const nlohmann::json& phases = reader.Array("phases");
  if (phases.empty() || phases.size() > kMaxPhases) {
    reader.Fail("phases", absl::StrCat("has ", phases.size(), " entries, must have 1 to ",
                                       kMaxPhases));
  }
  if (const absl::Status status = reader.Finish(); !status.ok()) {
    mistakes.emplace_back(status.message());
  }
  for (size_t i = 0; i < phases.size() && i < kMaxPhases; ++i) {
    const std::string place = absl::StrCat(where, ": ", PlaceOfPhase(phases[i], i));
    absl::StatusOr<PhaseConfig> phase = ParsePhase(phases[i], place);
    if (!phase.ok()) {
      mistakes.emplace_back(phase.status().message());
      continue;
    }
    phase->challenge = name;
    challenge.phases.push_back(*std::move(phase));
  }
  return challenge;
}

absl::Status MistakesToStatus(const std::vector<std::string>& mistakes) {
  if (mistakes.size() == 1) return absl::InvalidArgumentError(mistakes.front());
  return absl::InvalidArgumentError(absl::StrCat(
      mistakes.front(), " (the first of ", mistakes.size(),
      " mistakes; \"myograde phase check\" lists them all)"));
}

AdmissionRules PhaseRules(const PhaseConfig& phase, AdmissionRules fallback) {
  const PhaseQuota& own = phase.quota;
  QuotaLimits& limits = fallback.quota;
  limits.ranked.per_day = own.official_per_day.value_or(limits.ranked.per_day);
  limits.ranked.total = own.official_total.value_or(limits.ranked.total);
  limits.failed.per_day = own.failed_per_day.value_or(limits.failed.per_day);
  // A failed try is not charged as an evaluation, and each tells a little of what is hidden.
  const bool withholds = phase.shown != Visibility{} || phase.committed > 0;
  limits.failed.total = own.failed_total.value_or(
      withholds ? std::min(limits.failed.total, kHiddenFailures) : limits.failed.total);
  limits.waiting = own.waiting.value_or(limits.waiting);
  fallback.one_for_everyone = own.one_for_everyone.value_or(fallback.one_for_everyone);
  return fallback;
}

absl::StatusOr<scoring::StatisticsConfig> PhaseStatistics(const PhaseConfig& phase,
                                                          const scoring::StatisticsConfig& fallback) {
  return scoring::ParseStatistics(
      phase.statistics, absl::StrCat("phase \"", phase.name, "\": statistics"), fallback);
}

std::string_view TeamRuleName(scoring::TeamRule rule) {
  return kTeamRules[static_cast<size_t>(rule)];
}

std::string UtcText(absl::Time time) {
  return absl::FormatTime("%Y-%m-%d%ET%H:%M:%E*SZ", time, absl::UTCTimeZone());
}

}  // namespace myograde::server
