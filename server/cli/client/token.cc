// myograde token: create, list, revoke
#include <cstring>
#include <iostream>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
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
            << (token.value("expires_at", Json()).is_null() ? ", without an end"
                                                            : ", until " + Cell(token, "expires_at"))
            << ". It is shown this once:" << std::endl;
  // Whole, so that it can be copied.
  PlainOutput() << Cell(token, "token") << std::endl;
  std::cout << "Hand it over in private; whoever has it acts with it. \"myograde token revoke "
            << Cell(token, "id") << "\" ends it." << std::endl;
}

void PrintTokens(const Json& answer) {
  const Json tokens = answer.value("tokens", Json::array());
  if (tokens.empty()) {
    std::cout << "There are no tokens yet; \"myograde token create\" makes one." << std::endl;
  } else {
    Table table({"token", "role", "team", "label", "state", "made by", "until", "last used"});
    for (const Json& token : tokens) {
      table.Add({Cell(token, "id"), Cell(token, "role"), Cell(token, "team"),
                 Cell(token, "label"), Cell(token, "state"), Cell(token, "created_by"),
                 Cell(token, "expires_at"), Cell(token, "last_used_at")});
    }
    table.Print();
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

void PrintRevoked(const Json& token) {
  std::cout << "Token " << Cell(token, "id")
            << (token.value("changed", true) ? " is revoked."
                                             : " was revoked already; nothing changed.")
            << std::endl;
}

int CreateToken(const TokenOptions& options) {
  Json body = {{"role", options.role}, {"label", options.label}};
  if (!options.team.empty()) body["team"] = options.team;
  if (!options.expires.empty()) body["expires_at"] = options.expires;
  if (options.days != 0) body["valid_days"] = options.days;
  Client client = options.client();
  const absl::StatusOr<Json> token = client.Post("/v1/tokens", body);
  const int status = PrintAnswer(token, options.json, PrintCreated);
  const int error = FlushStandardOutput();
  if (!token.ok() || error == 0) return status;
  // Nobody has seen it, so nobody should find it among those that are valid.
  const absl::Status revoked =
      client.Post(absl::StrCat("/v1/tokens/", Cell(*token, "id"), "/revoke"), Json::object()).status();
  return ReportError(absl::InternalError(absl::StrCat(
      "token ", Cell(*token, "id"), " could not be printed (", std::strerror(error), "), so it ",
      revoked.ok() ? "is revoked; make another where its output can be written"
                   : absl::StrCat("should be revoked, which failed: ", revoked.message()))));
}

int ListTokens(const TokenOptions& options) {
  return PrintAnswer(GetAllPages(options.client(), "/v1/tokens", "tokens"), options.json,
                     PrintTokens);
}

int RevokeToken(const TokenOptions& options) {
  return PrintAnswer(options.client().Post(absl::StrCat("/v1/tokens/", options.id, "/revoke"),
                                           Json::object()),
                     options.json, PrintRevoked);
}

}  // namespace

Action AddToken(CLI::App& verb) {
  auto options = std::make_shared<TokenOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  const auto add = [&](const char* name, const char* does, const char* example, const char* schema,
                       int (*action)(const TokenOptions&)) {
    CLI::App* part = verb.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde token ", example));
    part->callback([=] { *chosen = [=] { return action(*options); }; });
    AddDaemonOptions(*part, schema, *options);
    return part;
  };
  CLI::App* create = add("create", "Make a token, which is shown once",
                         "create --team \"Team Blue\" --label \"Ada's laptop\" --days 90", "token",
                         CreateToken);
  create
      ->add_option("--role", options->role,
                   "participant, organiser or operator (default: participant)")
      ->check(CLI::IsMember({"participant", "organiser", "operator"}));
  create->add_option("--team", options->team, "The team that a participant's token acts for");
  create->add_option("--label", options->label, "Who will have it, or where; up to 100 bytes")
      ->required();
  CLI::Option* days = create
                          ->add_option("--days", options->days,
                                       "Days that it is valid for (default: it never expires)")
                          ->check(CLI::Range(1, 3650));
  create->add_option("--expires", options->expires, "When it expires, as in 2026-12-01T00:00:00Z")
      ->excludes(days);
  add("list", "List the tokens, without their texts", "list", "tokens", ListTokens);
  CLI::App* revoke = add("revoke", "Revoke a token at once", "revoke 7", "token", RevokeToken);
  revoke->add_option("ID", options->id, "The token")
      ->required()
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "no token's number, as \"myograde token list\" lists them"));
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
