// myograde challenge: check, status
#include "server/challenge/challenge.h"

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include <filesystem>
#include <iostream>
#include <set>
#include <string>
#include <vector>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/challenge/offered_tracks.h"
#include "server/challenge/phases.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/reference_check.h"

namespace myograde::server {
namespace {

constexpr double kDayS = 86400;

// "3 days 4 h" from one time of an answer to another.
std::string Span(const std::string& from, const std::string& to) {
  absl::Time begin;
  absl::Time end;
  std::string unused;
  if (!absl::ParseTime(absl::RFC3339_full, from, &begin, &unused) ||
      !absl::ParseTime(absl::RFC3339_full, to, &end, &unused)) {
    return "-";
  }
  const double seconds = absl::ToDoubleSeconds(end - begin);
  if (seconds < 2 * kDayS) return DurationText(seconds);
  const auto hours = static_cast<int64_t>(seconds / 3600);
  return absl::StrCat(hours / 24, " days ", hours % 24, " h");
}

// What happens next to a phase, and when.
std::string NextOf(const Json& phase, const std::string& now) {
  const std::string state = phase.value("state", "");
  if (state == "closed") return Filled(phase, "closed at {closes_at}");
  const char* key = state == "upcoming" ? "opens_at" : "closes_at";
  if (!phase[key].is_string()) return "stays open";
  return absl::StrCat(state == "upcoming" ? "opens" : "closes", " in ", Span(now, phase[key]),
                      ", at ", Cell(phase, key));
}

std::string BoardOf(const Json& phase) {
  if (phase.value("frozen", false)) return Filled(phase, "frozen at {freeze_at}");
  if (phase.value("published", false)) return "published";
  return Filled(phase, "open[, freezes at {freeze_at}]");
}

void PrintChallenge(const Json& challenge, const std::string& now) {
  const Json phases = challenge.value("phases", Json::array());
  const auto seeds = [](const Json& phase) {
    return Filled(phase, "{seeds.count} {seeds.kind}") +
           (phase.value("revealed", false) ? ", revealed" : "");
  };
  std::cout << Bold(Filled(challenge, "{title} ({challenge})")) << '\n';
  PrintRows(phases, {"phase", "track", "profile", "state",
                     RowColumn("next", [&](const Json& phase) { return NextOf(phase, now); }),
                     RowColumn("seeds", seeds), "entry", RowColumn("board", BoardOf), "waiting"});
  for (const Json& phase : phases) {
    const Json pause = phase.value("paused", Json());
    if (!pause.is_object() || pause.value("all", false)) continue;
    std::cout << Filled(phase, "  {phase} is paused since {paused.at}: {paused.reason}\n");
  }
  for (const Json& phase : phases) {
    if (!phase.value("seeds", Json::object()).contains("commitment")) continue;
    std::cout << Filled(phase, "  Commitment to the seeds of {phase}: {seeds.commitment}\n");
  }
}

void PrintChallenges(const Json& answer) {
  const Json challenges = answer.value("challenges", Json::array());
  if (challenges.empty()) {
    std::cout << "There is no challenge on this server: every track is open, on its own seeds.\n";
  }
  for (const Json& challenge : challenges) PrintChallenge(challenge, answer.value("now", ""));
  if (answer.value("paused", Json()).is_object()) {
    std::cout << Filled(answer, "All submissions are paused since {paused.at}: {paused.reason}\n");
  }
  for (const Json& phase : answer.value("former_phases", Json::array())) {
    std::cout << Filled(phase,
                        "Former phase {phase} of {track}: {submissions:submission}; its board "
                        "remains: \"myograde leaderboard --phase {phase}\"\n");
  }
  for (const Json& phase : answer.value("unusable", Json::array())) {
    std::cout << Filled(phase, "Phase {phase} accepts nothing: {message}\n");
  }
  std::cout.flush();
}

namespace fs = std::filesystem;
// `data` of check: a daemon's folder whose store is looked at too; "": none.
struct ChallengeOptions : DaemonOptions {
  HostOptions host;
  std::vector<std::string> files;
};

// Adds the challenge of a file, if it is one.
void AddFile(const std::string& file, std::vector<ChallengeConfig>& challenges,
             std::vector<std::string>& mistakes) {
  const std::string name = fs::path(file).stem().string();
  if (fs::path(file).extension() != ".json" || !IsTrackName(name)) {
    mistakes.push_back(absl::StrCat(file, ": rename it to NAME.json, where NAME has 1 to 64 of "
                                    "the characters a-z, 0-9 and \"-\""));
    return;
  }
  const absl::StatusOr<Json> json = ReadJsonFile(file);
  if (!json.ok()) {
    mistakes.emplace_back(json.status().message());
    return;
  }
  challenges.push_back(ReadChallenge(*json, name, file, mistakes));
  ReadChallengeText(file, challenges.back(), mistakes);
}

// All challenges that a daemon would have with these files: those of its folder, of which a file of
// the same name takes the place of one.
std::vector<ChallengeConfig> ChallengesWith(const ChallengeOptions& options,
                                            std::vector<std::string>& mistakes) {
  std::vector<ChallengeConfig> challenges;
  std::set<std::string> given;
  for (const std::string& file : options.files) {
    AddFile(file, challenges, mistakes);
    if (!given.insert(fs::path(file).stem().string()).second) {
      mistakes.push_back(absl::StrCat(file,
                                      ": another file has the same name; give only one of them"));
    }
  }
  std::vector<std::string> others_mistakes;
  const std::string folder = options.host.configs_dir() + "/challenges";
  for (ChallengeConfig& other : ReadChallenges(folder, others_mistakes)) {
    if (given.contains(other.name)) {
      // Its mistakes are no longer there either.
      std::erase_if(others_mistakes, [&](const std::string& mistake) {
        return mistake.starts_with(other.where);
      });
      continue;
    }
    challenges.push_back(std::move(other));
  }
  mistakes.insert(mistakes.end(), others_mistakes.begin(), others_mistakes.end());
  return challenges;
}

absl::StatusOr<int> ReportChallenges(const ChallengeOptions& options,
                                     const ChallengeFindings& found,
                                     const std::vector<ChallengeConfig>& challenges) {
  Json files = Json::array();
  for (const ChallengeConfig& challenge : challenges) files.push_back(challenge.where);
  return PrintAnswer(
      Json{{"valid", found.mistakes.empty()},
           {"files", std::move(files)},
           {"mistakes", found.mistakes},
           {"warnings", found.warnings}},
      options.json,
      [&](const Json&) {
        const auto print = [](const char* what, const std::vector<std::string>& texts) {
          for (const std::string& text : texts) std::cout << what << Sanitized(text) << '\n';
        };
        print("Mistake: ", found.mistakes);
        print("Warning: ", found.warnings);
        std::cout << Counted(std::ssize(challenges), "challenge") << ", "
                  << Counted(std::ssize(found.mistakes), "mistake") << ", "
                  << Counted(std::ssize(found.warnings), "warning") << "." << std::endl;
      },
      found.mistakes.empty() ? kDone : kWrongUse);
}

// What the store of a daemon with these challenges contradicts.
absl::Status AddStoreMistakes(const std::string& data,
                              const std::vector<ChallengeConfig>& challenges, absl::Time now,
                              std::vector<std::string>& mistakes) {
  std::error_code error;
  if (!fs::exists(data + "/store.db", error)) {
    return absl::InvalidArgumentError(
        absl::StrCat(data, ": has no store.db; name the daemon's data folder"));
  }
  ReaderPool readers(data + "/store.db");
  absl::Status status = readers.Read([&](const Transaction& reader) {
    ASSIGN_OR_RETURN(std::vector<std::string> found, CheckAgainstStore(challenges, reader, now));
    mistakes.insert(mistakes.end(), found.begin(), found.end());
    return absl::OkStatus();
  });
  return HostStatus("challenge check", status);
}

absl::StatusOr<int> CheckFiles(const ChallengeOptions& options) {
  ASSIGN_OR_RETURN(const Tracks tracks, Tracks::Load(options.host.configs_dir() + "/tracks"));
  std::vector<std::string> mistakes;
  const std::vector<ChallengeConfig> challenges = ChallengesWith(options, mistakes);
  // What can be read is checked even if the rest can't be.
  const absl::Time now = SystemClock().Now();
  ChallengeFindings found = CheckChallenges(challenges, tracks, now);
  if (!options.data.empty()) {
    RETURN_IF_ERROR(AddStoreMistakes(options.data, challenges, now, found.mistakes));
  }
  // A host with the client alone has neither server.json nor reference episodes.
  const References references(options.host.configs_dir() + "/reference");
  std::error_code error;
  for (const ChallengeConfig& challenge : challenges) {
    if (!fs::exists(options.host.configs_dir() + "/server.json", error)) break;
    for (const PhaseConfig& phase : challenge.phases) {
      const absl::StatusOr<TrackPtr> track = tracks.Find(phase.track, phase.profile);
      if (!track.ok()) continue;
      const std::string why = references.WhyLacking((*track)->config.kind->name);
      if (why.empty()) continue;
      found.mistakes.push_back(absl::StrCat(challenge.where, ": phase \"", phase.name, "\": nothing of "
                                            "the track ", phase.track, " can be ranked: ", why));
    }
  }
  found.mistakes.insert(found.mistakes.begin(), mistakes.begin(), mistakes.end());
  return ReportChallenges(options, found, challenges);
}

}  // namespace

Command AddChallenge(CLI::App& verb) {
  Parts<ChallengeOptions> parts(verb);
  ChallengeOptions& options = parts.options();
  CLI::App* check = parts.Add(
      "check",
      "Find mistakes in challenge files before a phase opens; exit status 2 if there are any",
      "check ./cup.json", CheckFiles);
  check->add_option("FILE", options.files,
                    "Challenge files, checked together with those of the configs (default: only "
                    "those)");
  check->add_option(
      "--data", options.data,
      "A daemon's data folder: also find conflicts with its store, such as a revealed phase that "
      "would open again");
  AddJson(*check, "challenge-check", options.json);
  AddHostOptions(*check, options.host);
  AddDaemonOptions(*parts.Add("status",
                              "Show the daemon's challenges: what is open, for how long, and what "
                              "is waiting",
                              "status",
                              [](const ChallengeOptions& daemon) {
                                return daemon.GetAndPrint("/v1/challenges", PrintChallenges);
                              }),
                   "challenge-status", options);
  return {};
}

}  // namespace myograde::server
