// myograde quota
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/report.h"
#include "server/cli/table.h"
#include "server/cli/terminal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct QuotaOptions {
  ApiOptions daemon;
  std::string team;
  std::string track;
  int64_t grant = 0;  // 0: not given
  std::string budget = "official";
  std::string reason;
  int64_t limit = 20;
  bool json = false;
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

void PrintQuota(const Json& quota) {
  std::cout << Bold(absl::StrCat("Quota of ", Cell(quota, "team"), " on ", Cell(quota, "day"),
                                 " (UTC)"))
            << '\n';
  Table table({"track", "budget", "today", "in all"});
  for (const Json& track : quota.value("tracks", Json::array())) {
    for (const char* budget : {"official", "practice", "failed"}) {
      const Json uses = track.value(budget, Json::object());
      table.Add({Cell(track, "track"), budget, UseText(uses.value("per_day", Json::object())),
                 UseText(uses.value("total", Json::object()))});
    }
    const Json waiting = track.value("waiting", Json::object());
    table.Add({Cell(track, "track"), "waiting",
               absl::StrCat(Cell(waiting, "used"), " of ", Cell(waiting, "limit")), "-"});
  }
  table.Print();
  std::cout << "The next day begins at " << Cell(quota, "next_day_at") << ".\n";
  PrintUnreadable(quota);
  const Json rows = quota.value("ledger", Json::array());
  if (rows.empty()) {
    std::cout << "The ledger is empty." << std::endl;
    return;
  }
  std::cout << Bold("Ledger, newest first") << '\n';
  Table ledger({"row", "at", "track", "budget", "entry", "amount", "submission", "who", "why"});
  for (const Json& row : rows) {
    ledger.Add({Cell(row, "id"), Cell(row, "at"), Cell(row, "track"), Cell(row, "budget"),
                Cell(row, "entry"), Cell(row, "amount"), Cell(row, "submission"),
                Cell(row, "who"), Cell(row, "why")});
  }
  ledger.Print();
  std::cout.flush();
}

int Quota(const QuotaOptions& options) {
  const Client client(options.daemon.path());
  absl::StatusOr<Json> quota = Json();
  if (options.grant != 0) {
    if (options.track.empty() || options.reason.empty()) {
      return Complain(absl::InvalidArgumentError("a grant needs --track and --reason"));
    }
    quota = client.Post("/v1/quota/grants", {{"team", options.team},
                                             {"track", options.track},
                                             {"budget", options.budget},
                                             {"amount", options.grant},
                                             {"reason", options.reason}});
  } else {
    std::string path = absl::StrCat("/v1/quota?team=", QueryValue(options.team),
                                    "&limit=", options.limit);
    if (!options.track.empty()) absl::StrAppend(&path, "&track=", QueryValue(options.track));
    quota = client.Get(path);
  }
  if (!quota.ok()) return Complain(quota.status());
  if (options.json) {
    PrintJson(*quota);
  } else {
    PrintQuota(*quota);
  }
  return kDone;
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
  verb.add_option("--reason", options->reason, "Why it is granted, for the ledger; up to 200 bytes")
      ->needs(grant);
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/quota.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Quota(*options); };
}

}  // namespace myograde::server
