// myograde team, quota
#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

constexpr const char* kBudgets[] = {"official", "practice", "failed"};

struct TeamOptions : DaemonOptions {
  std::string team;
  std::string name;  // rename: the new one
  std::string person;
  std::string into;
  std::string reason;
  bool dry_run = false;
  bool yes = false;

  std::string Resource(const std::string& part = "") const {
    return absl::StrCat("/v1/teams/", QueryValue(team), part);
  }
  // With the reason, if there is one.
  Json Body(Json body) const {
    SetIfGiven(body, "reason", reason);
    return body;
  }
};

void PrintTeam(const Json& team) {
  std::cout << Bold(Filled(team, "Team {team}")) << '\n'
            << "state        " << (team.value("banned", false) ? "banned" : "active") << '\n'
            << Filled(team, "created      {created_at}\nother names  {other_names}\n"
                            "submissions  {submissions}\n");
  const Json memberships = team.value("memberships", Json::array());
  if (memberships.empty()) {
    std::cout << "members      none\n";
  } else {
    PrintRows(memberships, {"member=person", "since=since_at", "added by=who"});
  }
  if (const Json events = team.value("events", Json::array()); !events.empty()) {
    PrintRows(events, {"at", "team", "event", "detail", "who", "why=reason"});
  }
  std::cout.flush();
}

// Of a verb that changes a team: one sentence.
AnswerPrinter Changed(const std::string& what) {
  return [what](const Json& team) {
    std::cout << "Team " << Cell(team, "team") << " " << Sanitized(what)
              << (team.value("changed", true) ? "." : " already; nothing changed.") << std::endl;
  };
}

absl::StatusOr<int> RenameTeam(const TeamOptions& options) {
  return options.PostAndPrint(
      options.Resource("/rename"), options.Body({{"name", options.name}}),
      Changed(absl::StrCat("has this name; \"", options.team, "\" still finds it")));
}

// "3 + 4 = 7 of 5".
std::string SumText(const Json& sum) {
  return absl::StrCat(Filled(sum, "{used_by_into} + {used_by_team} = {used} of "),
                      sum.value("limit", int64_t{0}) + sum.value("granted", int64_t{0}));
}

void PrintConsequences(const Json& merge) {
  std::cout << Bold(Filled(merge, "Merging {team} into {into}"))
            << Filled(merge,
                      "\nsubmissions  {submissions}, {submissions_of_team} of them of {team}; the "
                      "boards rank them as one team's\nmembers      {members}\n"
                      "tokens       {tokens_of_team:token} of {team} will act for {into}\n"
                      "names        {team} becomes an alias of {into}; a merge can't be undone\n"
                      "quota        the units used and granted add up; the limits stay those of "
                      "one team\n");
  Table table({"track or phase", "budget", "used today", "used in all", "left today"});
  for (const char* kind : {"tracks", "phases"}) {
    for (const Json& place : merge.value(kind, Json::array())) {
      for (const char* budget : kBudgets) {
        if (!place.contains(budget)) continue;
        const Json& sums = place[budget];
        const Json today = sums.value("per_day", Json::object());
        table.Add({Cell(place, place.contains("phase") ? "phase" : "track"), budget, SumText(today),
                   SumText(sums.value("total", Json::object())), Cell(today, "left")});
      }
    }
  }
  table.Print();
}

absl::StatusOr<Json> AskMerge(const TeamOptions& options, bool dry_run) {
  return options.client().Post(options.Resource("/merge"),
                               options.Body({{"into", options.into}, {"dry_run", dry_run}}));
}

// Whether the person at the terminal agrees.
bool Confirmed() {
  // Standard output keeps a line until it ends.
  PlainOutput() << "Merge them? [y/N] " << std::flush;
  std::string answer;
  std::getline(std::cin, answer);
  answer = absl::AsciiStrToLower(absl::StripAsciiWhitespace(answer));
  return answer == "y" || answer == "yes";
}

absl::StatusOr<int> MergeTeam(const TeamOptions& options) {
  const bool can_ask = !options.json && ::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1;
  if (!options.dry_run && !options.yes && !can_ask) {
    return absl::InvalidArgumentError(
        "a merge can't be undone: check its effect with --dry-run, then give --yes");
  }
  absl::StatusOr<Json> plan = AskMerge(options, /*dry_run=*/true);
  if (!plan.ok() || (options.dry_run && options.json)) {
    return PrintAnswer(plan, options.json, PrintConsequences);
  }
  if (!options.json) PrintConsequences(*plan);
  if (options.dry_run || (!options.yes && !Confirmed())) {
    std::cout << "Nothing was changed." << std::endl;
    return options.dry_run ? kDone : kNoScore;
  }
  return PrintAnswer(AskMerge(options, /*dry_run=*/false), options.json,
                     Sentence("Team {team} is now a part of team {into}, which has "
                              "{submissions:submission}."));
}

// The parts of the verb that are about one team.
class TeamParts : public DaemonParts<TeamOptions> {
 public:
  using DaemonParts::DaemonParts;

  CLI::App* AddOfTeam(const char* name, const char* does, const char* example,
                      std::function<absl::StatusOr<int>(const TeamOptions&)> action,
                      const char* schema = "team") {
    CLI::App* part = Add(name, does, example, schema, std::move(action));
    part->add_option("NAME", options().team, "The team")->required()->type_name("TEXT");
    return part;
  }
  CLI::Option* AddReason(CLI::App* part) {
    return part->add_option("--reason", options().reason, kReasonHelp);
  }
};

void AddMemberParts(TeamParts& parts) {
  for (const bool belongs : {true, false}) {
    CLI::App* part = parts.AddOfTeam(
        belongs ? "add-member" : "remove-member",
        belongs ? "Let a user of the daemon's host act for a team"
                : "Remove a user from a team; the user's submissions stay with the team",
        belongs ? "add-member \"Team Blue\" ada" : "remove-member \"Team Blue\" ada",
        [belongs](const TeamOptions& options) {
          const char* has = belongs ? "has the member " : "does not have the member ";
          return options.PostAndPrint(options.Resource("/members"),
                                      {{"person", options.person}, {"belongs", belongs}},
                                      Changed(has + options.person));
        });
    part->add_option("PERSON", parts.options().person,
                     "A user of the daemon's host: a name, or a number as in \"uid 1001\"")
        ->required()
        ->type_name("TEXT");
  }
}

void AddBanParts(TeamParts& parts) {
  for (const bool banned : {true, false}) {
    CLI::App* part = parts.AddOfTeam(
        banned ? "ban" : "unban",
        banned ? "Refuse a team's submissions and take it off the boards; running evaluations "
                 "continue"
               : "Accept a team's submissions again, and put it back on the boards",
        banned ? "ban \"Team Blue\" --reason \"two names of one group\"" : "unban \"Team Blue\"",
        [banned](const TeamOptions& options) {
          return options.PostAndPrint(options.Resource("/ban"), options.Body({{"banned", banned}}),
                                      Changed(banned ? "is banned" : "is not banned"));
        });
    parts.AddReason(part)->required(banned);
  }
}

struct QuotaOptions : DaemonOptions {
  std::string team;
  std::string track;
  std::string phase;
  int64_t units = 0;  // of a grant
  std::string budget = "official";
  std::string reason;
  int64_t limit = 20;
};

// "2 of 5 (1 of them open)".
std::string UseText(const Json& use) {
  const auto number = [&](const char* key) { return use.value(key, int64_t{0}); };
  return absl::StrCat(number("used") + number("open"), " of ", number("limit") + number("granted"),
                      number("open") > 0 ? Filled(use, " ({open} open)") : "");
}

// Whether anything of a track's budgets was ever used or granted.
bool IsUsed(const Json& place) {
  for (const char* budget : kBudgets) {
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
  for (const char* budget : kBudgets) {
    if (!place.contains(budget)) continue;
    const Json& uses = place[budget];
    table.Add({track, phase, budget, UseText(uses.value("per_day", Json::object())),
               UseText(uses.value("total", Json::object()))});
  }
  table.Add({track, phase, "waiting", Filled(place, "{waiting.used} of {waiting.limit}"), "-"});
}

void PrintQuota(const Json& quota) {
  std::cout << Bold(Filled(quota, "Quota of {team} on {day} (UTC)")) << '\n';
  Table table({"track", "phase", "budget", "today", "in all"});
  const Json phases = quota.value("phases", Json::array());
  for (const Json& place : phases) AddPlace(place, table);
  // In a challenge, the tracks themselves matter to few.
  int64_t left_out = 0;
  for (const Json& place : quota.value("tracks", Json::array())) {
    const bool shown = phases.empty() || IsUsed(place);
    if (shown) AddPlace(place, table);
    if (!shown) ++left_out;
  }
  table.Print();
  if (left_out > 0) {
    std::cout << "Left out: " << Counted(left_out, "track")
              << " that this team has not used outside the phases; --json lists them.\n";
  }
  std::cout << Filled(quota, "The next day begins at {next_day_at}.\n");
  const Json ledger = quota.value("ledger", Json::array());
  if (ledger.empty()) {
    std::cout << "The ledger is empty." << std::endl;
    return;
  }
  std::cout << Bold("Ledger, newest first") << '\n';
  PrintRows(ledger, {"row=id", "at", "track", "phase", "budget", "entry", "amount", "submission",
                     "who", "why"});
}

}  // namespace

Command AddTeam(CLI::App& verb) {
  TeamParts parts(verb);
  parts.AddReason(parts.AddOfTeam(
      "create", "Create a team", "create \"Team Blue\"", [](const TeamOptions& options) {
        return options.PostAndPrint("/v1/teams", options.Body({{"team", options.team}}),
                                    Changed("is created"));
      }));
  parts.Add("list", "List all teams with their members", "list", "teams",
            [](const TeamOptions& options) {
              const auto state = [](const Json& team) -> std::string {
                const std::string merged = Filled(team, "[merged into {merged_into}]");
                return !merged.empty() ? merged : team.value("banned", false) ? "banned" : "-";
              };
              return options.ListAndPrint(
                  "/v1/teams", "teams",
                  "There are no teams yet; create one with \"myograde team create NAME\".",
                  {"team", "members", "other names=other_names", RowColumn("state", state)});
            });
  parts.AddOfTeam("show", "Show a team with its members and its history",
                  "show \"Team Blue\"", [](const TeamOptions& options) {
                    return options.GetAndPrint(options.Resource(), PrintTeam);
                  });
  CLI::App* rename = parts.AddOfTeam("rename", "Rename a team; its old name still finds it",
                                     "rename \"Team Blue\" \"Team Green\"", RenameTeam);
  rename->add_option("NEW", parts.options().name, "The new name")->required()->type_name("TEXT");
  parts.AddReason(rename);
  AddMemberParts(parts);
  CLI::App* merge = parts.AddOfTeam(
      "merge", "Merge a team into another, after showing the effect on quotas and boards",
      "merge \"Team Blue\" --into \"Team Green\" --dry-run", MergeTeam, "team_merge");
  merge->add_option("--into", parts.options().into, "The team that remains")->required();
  merge->add_flag("--dry-run", parts.options().dry_run,
                  "Show the effect without changing anything");
  merge->add_flag("--yes", parts.options().yes, "Don't ask");
  parts.AddReason(merge);
  AddBanParts(parts);
  return {};
}

Command AddQuota(CLI::App& verb) {
  auto options = std::make_shared<QuotaOptions>();
  verb.add_option("--team", options->team, "Name of the team")->required();
  verb.add_option("--track", options->track, "Name of the track (default: all)");
  verb.add_option("--limit", options->limit, "Rows of the ledger to show, 1 to 1000 (default: 20)")
      ->check(CLI::Range(1, 1000));
  AddDaemonOptions(verb, "quota", *options);
  return [options] {
    return options->GetAndPrint("/v1/quota" + BuildQuery({{"team", options->team},
                                                          {"limit", absl::StrCat(options->limit)},
                                                          {"track", options->track}}),
                                PrintQuota);
  };
}

Command AddGrant(CLI::App& verb) {
  auto options = std::make_shared<QuotaOptions>();
  verb.add_option("NAME", options->team, "The team")->required()->type_name("TEXT");
  verb.add_option("--track", options->track, "Name of the track")->required();
  verb.add_option("--phase", options->phase,
                  "The phase to grant it for (default: the track itself)");
  verb.add_option("--units", options->units, "How many more, both for today and in total")
      ->required()
      ->check(CLI::Range(1, 1'000'000));
  verb.add_option("--budget", options->budget,
                  "What to grant: official, practice or failed (default: official)")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kBudgets), std::end(kBudgets))));
  verb.add_option("--reason", options->reason, "Why, for the ledger; up to 200 bytes")->required();
  AddDaemonOptions(verb, "quota", *options);
  return [options] {
    Json grant = {{"team", options->team},
                  {"track", options->track},
                  {"budget", options->budget},
                  {"amount", options->units},
                  {"reason", options->reason}};
    SetIfGiven(grant, "phase", options->phase);
    return options->PostAndPrint("/v1/quota/grants", grant, PrintQuota);
  };
}

}  // namespace myograde::server
