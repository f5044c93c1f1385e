#include "server/cli/client/challenge_status.h"

#include <iostream>
#include <string>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "server/cli/client/print_answer.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

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
  if (state == "closed") return absl::StrCat("closed at ", Cell(phase, "closes_at"));
  const char* key = state == "upcoming" ? "opens_at" : "closes_at";
  if (!phase[key].is_string()) return "stays open";
  const std::string when = phase[key].get<std::string>();
  return absl::StrCat(state == "upcoming" ? "opens" : "closes", " in ", Span(now, when), ", at ",
                      Harmless(when));
}

std::string SeedsOf(const Json& phase) {
  const Json seeds = phase.value("seeds", Json::object());
  return absl::StrCat(Cell(seeds, "count"), " ", Cell(seeds, "kind"),
                      phase.value("revealed", false) ? ", revealed" : "");
}

std::string BoardOf(const Json& phase) {
  if (phase.value("frozen", false)) return absl::StrCat("frozen at ", Cell(phase, "freeze_at"));
  if (phase.value("published", false)) return "published";
  return phase["freeze_at"].is_null() ? "open" : absl::StrCat("open, freezes at ",
                                                              Cell(phase, "freeze_at"));
}

void PrintPauses(const Json& challenge) {
  for (const Json& phase : challenge.value("phases", Json::array())) {
    const Json pause = phase.value("paused", Json());
    if (!pause.is_object() || pause.value("all", false)) continue;
    std::cout << "  " << Cell(phase, "phase") << " is paused since " << Cell(pause, "at") << ": "
              << Cell(pause, "reason") << '\n';
  }
}

void PrintCommitments(const Json& challenge) {
  for (const Json& phase : challenge.value("phases", Json::array())) {
    const Json seeds = phase.value("seeds", Json::object());
    if (!seeds.contains("commitment")) continue;
    std::cout << "  Commitment to the seeds of " << Cell(phase, "phase") << ": "
              << Cell(seeds, "commitment") << '\n';
  }
}

void PrintChallenge(const Json& challenge, const std::string& now) {
  std::cout << Bold(absl::StrCat(Cell(challenge, "title"), " (", Cell(challenge, "challenge"), ")"))
            << '\n';
  Table table({"phase", "track", "profile", "state", "next", "seeds", "entry", "board", "waiting"});
  for (const Json& phase : challenge.value("phases", Json::array())) {
    table.Add({Cell(phase, "phase"), Cell(phase, "track"), Cell(phase, "profile"),
               Cell(phase, "state"), NextOf(phase, now), SeedsOf(phase), Cell(phase, "entry"),
               BoardOf(phase), Cell(phase, "waiting")});
  }
  table.Print();
  PrintPauses(challenge);
  PrintCommitments(challenge);
}

void PrintStatus(const Json& answer) {
  const Json challenges = answer.value("challenges", Json::array());
  if (challenges.empty()) {
    std::cout << "No challenge is held here: every track is open, on its own seeds.\n";
  }
  for (const Json& challenge : challenges) PrintChallenge(challenge, answer.value("now", ""));
  if (const Json pause = answer.value("paused", Json()); pause.is_object()) {
    std::cout << "All submissions are paused since " << Cell(pause, "at") << ": "
              << Cell(pause, "reason") << '\n';
  }
  for (const Json& phase : answer.value("former_phases", Json::array())) {
    std::cout << "Former phase " << Cell(phase, "phase") << " of " << Cell(phase, "track") << ": "
              << CountCell(phase, "submissions", "submission") << "; its board stays, with "
              << "\"myograde leaderboard --phase " << Cell(phase, "phase") << "\"\n";
  }
  for (const Json& phase : answer.value("unusable", Json::array())) {
    std::cout << "Phase " << Cell(phase, "phase") << " takes nothing: " << Cell(phase, "message")
              << '\n';
  }
  std::cout.flush();
}

}  // namespace

int ChallengeStatus(const DaemonOptions& options) {
  return PrintAnswer(options.client().Get("/v1/challenges"), options.json, PrintStatus);
}

}  // namespace myograde::server
