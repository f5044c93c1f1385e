// myograde team, myograde token
#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <cstring>
#include <functional>
#include <iostream>
#include <string>
#include <utility>

#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

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
  Json Body(Json body = Json::object()) const {
    if (!reason.empty()) body["reason"] = reason;
    return body;
  }
};

RowColumn ListColumn(const char* head, const char* key) {
  return {head, [key](const Json& row) { return ListCell(row, key); }};
}

std::string StateText(const Json& team) {
  if (!team.value("merged_into", Json()).is_null()) {
    return "merged into " + Cell(team, "merged_into");
  }
  return team.value("banned", false) ? "banned" : "-";
}

void PrintTeam(const Json& team) {
  std::cout << Bold(absl::StrCat("Team ", Cell(team, "team"))) << '\n'
            << "state        " << (team.value("banned", false) ? "banned" : "active") << '\n'
            << "created      " << Cell(team, "created_at") << '\n'
            << "other names  " << ListCell(team, "other_names") << '\n'
            << "submissions  " << Cell(team, "submissions") << '\n';
  const Json memberships = team.value("memberships", Json::array());
  if (memberships.empty()) {
    std::cout << "members      none\n";
  } else {
    PrintRows(memberships, {"member=person", "since=since_at", "added by=who"});
  }
  if (const Json events = team.value("events", Json::array()); !events.empty()) {
    PrintRows(events, {"at", "team", "event", "detail", "who", "why=reason"});
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

absl::StatusOr<int> CreateTeam(const TeamOptions& options) {
  return options.PostAndPrint("/v1/teams", options.Body({{"team", options.team}}),
                              Sentence("is created"));
}

absl::StatusOr<int> ListTeams(const TeamOptions& options) {
  return PrintAnswer(
      GetAllPages(options.client(), "/v1/teams", "teams"), options.json, [](const Json& answer) {
        PrintList(answer, "teams",
                  "There are no teams yet; \"myograde team create NAME\" makes one.",
                  {"team", ListColumn("members", "members"),
                   ListColumn("other names", "other_names"), RowColumn("state", StateText)});
      });
}

absl::StatusOr<int> ShowTeam(const TeamOptions& options) {
  return options.GetAndPrint(options.Resource(), PrintTeam);
}

absl::StatusOr<int> RenameTeam(const TeamOptions& options) {
  return options.PostAndPrint(
      options.Resource("/rename"), options.Body({{"name", options.name}}),
      Sentence(absl::StrCat("has this name; \"", options.team, "\" still finds it")));
}

absl::StatusOr<int> SetTeamMember(const TeamOptions& options, bool belongs) {
  return options.PostAndPrint(
      options.Resource("/members"), {{"person", options.person}, {"belongs", belongs}},
      Sentence(absl::StrCat(belongs ? "has" : "does not have", " the member ", options.person)));
}

absl::StatusOr<int> BanTeam(const TeamOptions& options, bool banned) {
  return options.PostAndPrint(options.Resource("/ban"), options.Body({{"banned", banned}}),
                              Sentence(banned ? "is banned" : "is not banned"));
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
            << "members      " << ListCell(merge, "members") << '\n'
            << "tokens       " << CountCell(merge, "tokens_of_team", "token") << " of " << team
            << " will act for " << into << '\n'
            << "names        " << team << " will find " << into << "; a merge can't be undone\n"
            << "quota        units that both have used add up, and so do grants; the limits stay "
               "those of one team\n";
  Table table({"track or phase", "budget", "used today", "used in all", "left today"});
  for (const char* kind : {"tracks", "phases"}) {
    for (const Json& place : merge.value(kind, Json::array())) {
      for (const char* budget : {"official", "practice", "failed"}) {
        if (!place.contains(budget)) continue;
        const Json sums = place.value(budget, Json::object());
        const Json today = sums.value("per_day", Json::object());
        table.Add({Cell(place, place.contains("phase") ? "phase" : "track"), budget, SumText(today),
                   SumText(sums.value("total", Json::object())), Cell(today, "left")});
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

absl::StatusOr<int> MergeTeam(const TeamOptions& options) {
  const bool can_ask = !options.json && ::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1;
  if (!options.dry_run && !options.yes && !can_ask) {
    return absl::InvalidArgumentError(
        "a merge can't be undone: see what it does with --dry-run, then give --yes");
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
    std::cout << "Team " << Cell(merge, "team") << " is now a part of team " << Cell(merge, "into")
              << ", which has " << CountCell(merge, "submissions", "submission") << "."
              << std::endl;
  });
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
    return part->add_option("--reason", options().reason, "Why, for the record; up to 200 bytes");
  }
};

void AddMemberParts(TeamParts& parts) {
  for (const bool belongs : {true, false}) {
    CLI::App* part = parts.AddOfTeam(
        belongs ? "add-member" : "remove-member",
        belongs ? "Let a user of the daemon's host act for a team"
                : "Remove a user from a team; what the user has submitted stays the team's",
        belongs ? "add-member \"Team Blue\" ada" : "remove-member \"Team Blue\" ada",
        [belongs](const TeamOptions& options) { return SetTeamMember(options, belongs); });
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
        banned ? "Refuse a team's submissions and take it off the boards; running ones continue"
               : "Accept a team's submissions again, and put it back on the boards",
        banned ? "ban \"Team Blue\" --reason \"two names of one group\"" : "unban \"Team Blue\"",
        [banned](const TeamOptions& options) { return BanTeam(options, banned); });
    parts.AddReason(part)->required(banned);
  }
}

struct TokenOptions : DaemonOptions {
  std::string role = "participant";
  std::string team;
  std::string label;
  std::string expires;
  int64_t days = 0;  // 0: not given
  int64_t id = 0;
};

void PrintCreated(const Json& token) {
  std::cout << "Token " << Cell(token, "id") << " for "
            << (token.value("team", Json()).is_null() ? "an " + Cell(token, "role")
                                                      : "team " + Cell(token, "team"))
            << (token.value("expires_at", Json()).is_null()
                    ? ", without an end"
                    : ", until " + Cell(token, "expires_at"))
            << ". It is shown this once:" << std::endl;
  // Whole, so that it can be copied.
  PlainOutput() << Cell(token, "token") << std::endl;
  std::cout << "Hand it over in private; whoever has it acts with it. \"myograde token revoke "
            << Cell(token, "id") << "\" ends it." << std::endl;
}

void PrintRevoked(const Json& token) {
  std::cout << "Token " << Cell(token, "id")
            << (token.value("changed", true) ? " is revoked."
                                             : " was revoked already; nothing changed.")
            << std::endl;
}

absl::StatusOr<int> CreateToken(const TokenOptions& options) {
  Json body = {{"role", options.role}, {"label", options.label}};
  if (!options.team.empty()) body["team"] = options.team;
  if (!options.expires.empty()) body["expires_at"] = options.expires;
  if (options.days != 0) body["valid_days"] = options.days;
  const Client client = options.client();
  const absl::StatusOr<Json> token = client.Post("/v1/tokens", body);
  const absl::StatusOr<int> status = PrintAnswer(token, options.json, PrintCreated);
  const int error = FlushStandardOutput();
  if (!token.ok() || error == 0) return status;
  // Nobody has seen it, so nobody should find it among those that are valid.
  const absl::Status revoked =
      client.Post(absl::StrCat("/v1/tokens/", Cell(*token, "id"), "/revoke"), Json::object())
          .status();
  return absl::InternalError(absl::StrCat(
      "token ", Cell(*token, "id"), " could not be printed (", std::strerror(error), "), so it ",
      revoked.ok() ? "is revoked; make another where its output can be written"
                   : absl::StrCat("should be revoked, which failed: ", revoked.message())));
}

absl::StatusOr<int> ListTokens(const TokenOptions& options) {
  return PrintAnswer(
      GetAllPages(options.client(), "/v1/tokens", "tokens"), options.json, [](const Json& answer) {
        PrintList(answer, "tokens", "There are no tokens yet; \"myograde token create\" makes one.",
                  {"token=id", "role", "team", "label", "state", "made by=created_by",
                   "until=expires_at", "last used=last_used_at"});
      });
}

absl::StatusOr<int> RevokeToken(const TokenOptions& options) {
  return options.PostAndPrint(absl::StrCat("/v1/tokens/", options.id, "/revoke"), Json::object(),
                              PrintRevoked);
}

}  // namespace

Action AddTeam(CLI::App& verb) {
  TeamParts parts(verb);
  parts.AddReason(parts.AddOfTeam("create", "Make a team", "create \"Team Blue\"", CreateTeam));
  parts.Add("list", "List all teams with their members", "list", "teams", ListTeams);
  parts.AddOfTeam("show", "Show a team with its members and all that was done to it",
                  "show \"Team Blue\"", ShowTeam);
  CLI::App* rename = parts.AddOfTeam("rename", "Rename a team; its old name still finds it",
                                     "rename \"Team Blue\" \"Team Green\"", RenameTeam);
  rename->add_option("NEW", parts.options().name, "The new name")->required()->type_name("TEXT");
  parts.AddReason(rename);
  AddMemberParts(parts);
  CLI::App* merge = parts.AddOfTeam(
      "merge", "Merge a team into another, after showing what that does to quotas and boards",
      "merge \"Team Blue\" --into \"Team Green\" --dry-run", MergeTeam, "team_merge");
  merge->add_option("--into", parts.options().into, "The team that remains")->required();
  merge->add_flag("--dry-run", parts.options().dry_run, "Show what it does, and change nothing");
  merge->add_flag("--yes", parts.options().yes, "Don't ask");
  parts.AddReason(merge);
  AddBanParts(parts);
  return parts.Chosen();
}

Action AddToken(CLI::App& verb) {
  DaemonParts<TokenOptions> parts(verb);
  TokenOptions& options = parts.options();
  CLI::App* create = parts.Add("create", "Make a token, which is shown once",
                               "create --team \"Team Blue\" --label \"Ada's laptop\" --days 90",
                               "token", CreateToken);
  create
      ->add_option("--role", options.role,
                   "participant, organiser or operator (default: participant)")
      ->check(CLI::IsMember({"participant", "organiser", "operator"}));
  create->add_option("--team", options.team, "The team that a participant's token acts for");
  create->add_option("--label", options.label, "Who will have it, or where; up to 100 bytes")
      ->required();
  CLI::Option* days = create
                          ->add_option("--days", options.days,
                                       "Days that it is valid for (default: it never expires)")
                          ->check(CLI::Range(1, 3650));
  create->add_option("--expires", options.expires, "When it expires, as in 2026-12-01T00:00:00Z")
      ->excludes(days);
  parts.Add("list", "List the tokens, without their texts", "list", "tokens", ListTokens);
  parts.Add("revoke", "Revoke a token at once", "revoke 7", "token", RevokeToken)
      ->add_option("ID", options.id, "The token")
      ->required()
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "no token's number, as \"myograde token list\" lists them"));
  return parts.Chosen();
}

}  // namespace myograde::server
