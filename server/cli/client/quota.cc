// myograde quota
#include <absl/strings/str_cat.h>

#include <iostream>
#include <memory>

#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

struct QuotaOptions : DaemonOptions {
  std::string team;
  std::string track;
  std::string phase;
  int64_t grant = 0;  // 0: not given
  std::string budget = "official";
  std::string reason;
  int64_t limit = 20;
};

// "2 of 5 (1 of them open)".
std::string UseText(const Json& use) {
  const int64_t open = use.value("open", int64_t{0});
  const int64_t limit = use.value("limit", int64_t{0}) + use.value("granted", int64_t{0});
  std::string text =
      absl::StrCat(use.value("used", int64_t{0}) + open, " of ", limit);
  if (open > 0) absl::StrAppend(&text, " (", open, " open)");
  return text;
}

// Whether anything of a track's budgets was ever used or granted.
bool IsUsed(const Json& place) {
  for (const char* budget : {"official", "practice", "failed"}) {
    const Json total = place.value(budget, Json::object()).value("total", Json::object());
    for (const char* kind : {"used", "open", "granted"}) {
      if (total.value(kind, int64_t{0}) != 0) return true;
    }
  }
  return false;
}

// The budgets of a track or a phase.
void AddPlace(const Json& place, Table& table) {
  const std::string track = Cell(place, "track");
  const std::string phase = Cell(place, "phase");
  for (const char* budget : {"official", "practice", "failed"}) {
    if (!place.contains(budget)) continue;
    const Json uses = place.value(budget, Json::object());
    table.Add({track, phase, budget, UseText(uses.value("per_day", Json::object())),
               UseText(uses.value("total", Json::object()))});
  }
  const Json waiting = place.value("waiting", Json::object());
  table.Add({track, phase, "waiting",
             absl::StrCat(Cell(waiting, "used"), " of ", Cell(waiting, "limit")), "-"});
}

void PrintQuota(const Json& quota) {
  std::cout << Bold(absl::StrCat("Quota of ", Cell(quota, "team"), " on ", Cell(quota, "day"),
                                 " (UTC)"))
            << '\n';
  Table table({"track", "phase", "budget", "today", "in all"});
  const Json phases = quota.value("phases", Json::array());
  for (const Json& place : phases) AddPlace(place, table);
  // In a challenge, the tracks themselves matter to few.
  int64_t left_out = 0;
  for (const Json& place : quota.value("tracks", Json::array())) {
    if (phases.empty() || IsUsed(place)) {
      AddPlace(place, table);
    } else {
      ++left_out;
    }
  }
  table.Print();
  if (left_out > 0) {
    std::cout << "Left out: " << Counted(left_out, "track")
              << " that this team has not used outside the phases; --json has them.\n";
  }
  std::cout << "The next day begins at " << Cell(quota, "next_day_at") << ".\n";
  PrintUnreadable(quota);
  const Json ledger = quota.value("ledger", Json::array());
  if (ledger.empty()) {
    std::cout << "The ledger is empty." << std::endl;
    return;
  }
  std::cout << Bold("Ledger, newest first") << '\n';
  PrintRows(ledger, {"row=id", "at", "track", "phase", "budget", "entry", "amount", "submission",
                     "who", "why"});
}

absl::StatusOr<Json> Grant(const QuotaOptions& options) {
  if (options.track.empty() || options.reason.empty()) {
    return absl::InvalidArgumentError("a grant needs --track and --reason");
  }
  Json grant = {{"team", options.team},
                {"track", options.track},
                {"budget", options.budget},
                {"amount", options.grant},
                {"reason", options.reason}};
  if (!options.phase.empty()) grant["phase"] = options.phase;
  return options.client().Post("/v1/quota/grants", grant);
}

absl::StatusOr<Json> QuotaOf(const QuotaOptions& options) {
  std::string path = absl::StrCat("/v1/quota?team=", QueryValue(options.team),
                                  "&limit=", options.limit);
  if (!options.track.empty()) absl::StrAppend(&path, "&track=", QueryValue(options.track));
  return options.client().Get(path);
}

}  // namespace

Action AddQuota(CLI::App& verb) {
  auto options = std::make_shared<QuotaOptions>();
  verb.add_option("--team", options->team, "Name of the team")->required();
  verb.add_option("--track", options->track, "Name of the track (default: all)");
  verb.add_option("--limit", options->limit, "Rows of the ledger to show, 1 to 1000 (default: 20)")
      ->check(CLI::Range(1, 1000));
  CLI::Option* grant =
      verb.add_option("--grant", options->grant,
                      "Organiser: give N more, for the present day and in all (needs --track and "
                      "--reason)")
          ->check(CLI::Range(1, 1'000'000));
  verb.add_option("--budget", options->budget,
                  "What to grant: official, practice or failed (default: official)")
      ->check(CLI::IsMember({"official", "practice", "failed"}))
      ->needs(grant);
  verb.add_option("--phase", options->phase,
                  "The phase to grant it for (default: the track itself)")
      ->needs(grant);
  verb.add_option("--reason", options->reason, "Why it is granted, for the ledger; up to 200 bytes")
      ->needs(grant);
  AddDaemonOptions(verb, "quota", *options);
  return [options] {
    return PrintAnswer(options->grant != 0 ? Grant(*options) : QuotaOf(*options), options->json,
                       PrintQuota);
  };
}

}  // namespace myograde::server
