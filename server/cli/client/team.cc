// myograde team: create, list, show, rename, add-member, remove-member, merge, ban, unban
#include <unistd.h>

#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/pages.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct TeamOptions : DaemonOptions {
  std::string team;
  std::string name;    // rename: the new one
  std::string person;
  std::string into;
  std::string reason;
  bool dry_run = false;
  bool yes = false;

  std::string Resource(const std::string& part = "") const {
    return absl::StrCat("/v1/teams/", QueryValue(team), part);
  }
  // With the reason, if there is one.
  Json Body(Json body = Json::object()) const {
    if (!reason.empty()) body["reason"] = reason;
    return body;
  }
};

// "uid 1001, uid 1002", or "-".
std::string ListText(const Json& object, const char* key) {
  std::vector<std::string> texts;
  for (const Json& text : object.value(key, Json::array())) texts.push_back(text);
  return texts.empty() ? "-" : Harmless(absl::StrJoin(texts, ", "));
}

std::string StateText(const Json& team) {
  if (!team.value("merged_into", Json()).is_null()) {
    return "merged into " + Cell(team, "merged_into");
  }
  return team.value("banned", false) ? "banned" : "-";
}

void PrintTeams(const Json& answer) {
  const Json teams = answer.value("teams", Json::array());
  if (teams.empty()) {
    std::cout << "There are no teams yet; \"myograde team create NAME\" makes one." << std::endl;
  } else {
    Table table({"team", "members", "other names", "state"});
    for (const Json& team : teams) {
      table.Add({Cell(team, "team"), ListText(team, "members"), ListText(team, "other_names"),
                 StateText(team)});
    }
    table.Print();
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

void PrintTeam(const Json& team) {
  std::cout << Bold(absl::StrCat("Team ", Cell(team, "team"))) << '\n'
            << "state        " << (team.value("banned", false) ? "banned" : "active") << '\n'
            << "created      " << Cell(team, "created_at") << '\n'
            << "other names  " << ListText(team, "other_names") << '\n'
            << "submissions  " << Cell(team, "submissions") << '\n';
  const Json memberships = team.value("memberships", Json::array());
  if (memberships.empty()) {
    std::cout << "members      none\n";
  } else {
    Table members({"member", "since", "added by"});
    for (const Json& member : memberships) {
      members.Add({Cell(member, "person"), Cell(member, "since_at"), Cell(member, "who")});
    }
    members.Print();
  }
  if (const Json events = team.value("events", Json::array()); !events.empty()) {
    Table table({"at", "team", "event", "detail", "who", "why"});
    for (const Json& event : events) {
      table.Add({Cell(event, "at"), Cell(event, "team"), Cell(event, "event"),
                 Cell(event, "detail"), Cell(event, "who"), Cell(event, "reason")});
    }
    table.Print();
  }
  PrintUnreadable(team);
  std::cout.flush();
}

// Of a verb that changes a team: one sentence.
std::function<void(const Json&)> Sentence(const std::string& what) {
  return [what](const Json& team) {
    std::cout << "Team " << Cell(team, "team") << " " << Harmless(what)
              << (team.value("changed", true) ? "." : " already; nothing changed.") << std::endl;
  };
}

int CreateTeam(const TeamOptions& options) {
  return PrintAnswer(options.client().Post("/v1/teams", options.Body({{"team", options.team}})),
                     options.json, Sentence("is created"));
}

int ListTeams(const TeamOptions& options) {
  return PrintAnswer(GetAllPages(options.client(), "/v1/teams", "teams"), options.json,
                     PrintTeams);
}

int ShowTeam(const TeamOptions& options) {
  return PrintAnswer(options.client().Get(options.Resource()), options.json, PrintTeam);
}

int RenameTeam(const TeamOptions& options) {
  const Json body = options.Body({{"name", options.name}});
  return PrintAnswer(options.client().Post(options.Resource("/rename"), body), options.json,
                     Sentence(absl::StrCat("has this name; \"", options.team,
                                           "\" still finds it")));
}

int SetTeamMember(const TeamOptions& options, bool belongs) {
  return PrintAnswer(options.client().Post(options.Resource("/members"),
                                           {{"person", options.person}, {"belongs", belongs}}),
                     options.json,
                     Sentence(absl::StrCat(belongs ? "has" : "does not have", " the member ",
                                           options.person)));
}

int BanTeam(const TeamOptions& options, bool banned) {
  return PrintAnswer(options.client().Post(options.Resource("/ban"),
                                           options.Body({{"banned", banned}})),
                     options.json, Sentence(banned ? "is banned" : "is not banned"));
}

// "3 + 4 = 7 of 5".
std::string SumText(const Json& sum) {
  return absl::StrCat(Cell(sum, "used_by_into"), " + ", Cell(sum, "used_by_team"), " = ",
                      Cell(sum, "used"), " of ",
                      sum.value("limit", int64_t{0}) + sum.value("granted", int64_t{0}));
}

void PrintConsequences(const Json& merge) {
  const std::string team = Cell(merge, "team");
  const std::string into = Cell(merge, "into");
  std::cout << Bold(absl::StrCat("Merging ", team, " into ", into)) << '\n'
            << "submissions  " << Cell(merge, "submissions") << ", "
            << Cell(merge, "submissions_of_team") << " of them of " << team
            << "; the boards rank them as one team's\n"
            << "members      " << ListText(merge, "members") << '\n'
            << "tokens       " << CountCell(merge, "tokens_of_team", "token") << " of " << team
            << " will act for " << into << '\n'
            << "names        " << team << " will find " << into
            << "; a merge can't be undone\n"
            << "quota        units that both have used add up, and so do grants; the limits stay "
               "those of one team\n";
  Table table({"track or phase", "budget", "used today", "used in all", "left today"});
  for (const char* kind : {"tracks", "phases"}) {
    for (const Json& place : merge.value(kind, Json::array())) {
      for (const char* budget : {"official", "practice", "failed"}) {
        if (!place.contains(budget)) continue;
        const Json sums = place.value(budget, Json::object());
        const Json today = sums.value("per_day", Json::object());
        table.Add({Cell(place, place.contains("phase") ? "phase" : "track"), budget,
                   SumText(today), SumText(sums.value("total", Json::object())),
                   Cell(today, "left")});
      }
    }
  }
  table.Print();
  std::cout.flush();
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
  const std::string word = absl::AsciiStrToLower(absl::StripAsciiWhitespace(answer));
  return word == "y" || word == "yes";
}

int MergeTeam(const TeamOptions& options) {
  const bool can_ask = !options.json && ::isatty(STDIN_FILENO) == 1 &&
                       ::isatty(STDOUT_FILENO) == 1;
  if (!options.dry_run && !options.yes && !can_ask) {
    return ReportError(absl::InvalidArgumentError(
        "a merge can't be undone: see what it does with --dry-run, then give --yes"));
  }
  absl::StatusOr<Json> plan = AskMerge(options, /*dry_run=*/true);
  if (!plan.ok() || (options.dry_run && options.json)) {
    return PrintAnswer(plan, options.json, PrintConsequences);
  }
  if (!options.json) PrintConsequences(*plan);
  if (options.dry_run) {
    std::cout << "Nothing was changed." << std::endl;
    return kDone;
  }
  if (!options.yes && !Confirmed()) {
    std::cout << "Nothing was changed." << std::endl;
    return kNoScore;
  }
  return PrintAnswer(AskMerge(options, /*dry_run=*/false), options.json, [](const Json& merge) {
    std::cout << "Team " << Cell(merge, "team") << " is now a part of team "
              << Cell(merge, "into") << ", which has " << CountCell(merge, "submissions",
                                                                    "submission")
              << "." << std::endl;
  });
}

// The parts of the verb, which share their options.
class Parts {
 public:
  explicit Parts(CLI::App& verb) : verb_(verb) { verb_.require_subcommand(1); }

  CLI::App* Add(const char* name, const char* does, const char* example, const char* schema,
                std::function<int(const TeamOptions&)> action) {
    CLI::App* part = verb_.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde team ", example));
    part->callback([chosen = chosen_, options = options_, action = std::move(action)] {
      *chosen = [options, action] { return action(*options); };
    });
    AddDaemonOptions(*part, schema, *options_);
    return part;
  }
  // The same about one team.
  CLI::App* AddOfTeam(const char* name, const char* does, const char* example, const char* schema,
                      std::function<int(const TeamOptions&)> action) {
    CLI::App* part = Add(name, does, example, schema, std::move(action));
    part->add_option("NAME", options_->team, "The team")->required()->type_name("TEXT");
    return part;
  }
  CLI::Option* AddReason(CLI::App* part) {
    return part->add_option("--reason", options_->reason, "Why, for the record; up to 200 bytes");
  }
  TeamOptions& options() { return *options_; }
  Action Chosen() const {
    return [chosen = chosen_] { return (*chosen)(); };
  }

 private:
  CLI::App& verb_;
  std::shared_ptr<TeamOptions> options_ = std::make_shared<TeamOptions>();
  std::shared_ptr<Action> chosen_ = std::make_shared<Action>();
};

void AddMemberParts(Parts& parts) {
  for (const bool belongs : {true, false}) {
    CLI::App* part = parts.AddOfTeam(
        belongs ? "add-member" : "remove-member",
        belongs ? "Let a user of the daemon's host act for a team"
                : "Remove a user from a team; what the user has submitted stays the team's",
        belongs ? "add-member \"Team Blue\" ada" : "remove-member \"Team Blue\" ada", "team",
        [belongs](const TeamOptions& options) { return SetTeamMember(options, belongs); });
    part->add_option("PERSON", parts.options().person,
                     "A user of the daemon's host: a name, or a number as in \"uid 1001\"")
        ->required()
        ->type_name("TEXT");
  }
}

void AddBanParts(Parts& parts) {
  for (const bool banned : {true, false}) {
    CLI::App* part = parts.AddOfTeam(
        banned ? "ban" : "unban",
        banned ? "Refuse a team's submissions and take it off the boards; running ones continue"
               : "Accept a team's submissions again, and put it back on the boards",
        banned ? "ban \"Team Blue\" --reason \"two names of one group\"" : "unban \"Team Blue\"",
        "team", [banned](const TeamOptions& options) { return BanTeam(options, banned); });
    parts.AddReason(part)->required(banned);
  }
}

}  // namespace

Action AddTeam(CLI::App& verb) {
  Parts parts(verb);
  parts.AddReason(parts.AddOfTeam("create", "Make a team", "create \"Team Blue\"", "team", CreateTeam));
  parts.Add("list", "List all teams with their members", "list", "teams", ListTeams);
  parts.AddOfTeam("show", "Show a team with its members and all that was done to it",
                  "show \"Team Blue\"", "team", ShowTeam);
  CLI::App* rename = parts.AddOfTeam("rename", "Rename a team; its old name still finds it",
                                     "rename \"Team Blue\" \"Team Green\"", "team", RenameTeam);
  rename->add_option("NEW", parts.options().name, "The new name")->required()->type_name("TEXT");
  parts.AddReason(rename);
  AddMemberParts(parts);
  CLI::App* merge = parts.AddOfTeam(
      "merge", "Merge a team into another, after showing what that does to quotas and boards",
      "merge \"Team Blue\" --into \"Team Green\" --dry-run", "team_merge", MergeTeam);
  merge->add_option("--into", parts.options().into, "The team that remains")->required();
  merge->add_flag("--dry-run", parts.options().dry_run, "Show what it does, and change nothing");
  merge->add_flag("--yes", parts.options().yes, "Don't ask");
  parts.AddReason(merge);
  AddBanParts(parts);
  return parts.Chosen();
}

}  // namespace myograde::server
