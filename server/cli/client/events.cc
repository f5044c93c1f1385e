// myograde events
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct EventsOptions : DaemonOptions {
  std::string kind;
  int64_t limit = 100;
  int64_t before = 0;  // 0: not given
};

void PrintEvents(const Json& answer) {
  PrintUnreadable(answer);
  const Json events = answer.value("events", Json::array());
  if (events.empty()) {
    std::cout << "Nothing was denied, and no organiser did anything." << std::endl;
    return;
  }
  Table table({"id", "at", "kind", "who", "role", "action", "subject", "detail", "times"});
  for (const Json& event : events) {
    table.Add({Cell(event, "id"), Cell(event, "at"), Cell(event, "kind"), Cell(event, "who"),
               Cell(event, "role"), Cell(event, "action"), Cell(event, "subject"),
               Cell(event, "detail"), Cell(event, "count")});
  }
  table.Print();
  if (answer.contains("next_before") && answer["next_before"].is_number()) {
    std::cout << "Older ones: --before " << Cell(answer, "next_before") << std::endl;
  }
}

int Events(const EventsOptions& options) {
  std::string path = absl::StrCat("/v1/events?limit=", options.limit);
  if (options.before != 0) absl::StrAppend(&path, "&before=", options.before);
  if (!options.kind.empty()) absl::StrAppend(&path, "&kind=", options.kind);
  return PrintAnswer(options.client().Get(path), options.json, PrintEvents);
}

}  // namespace

Action AddEvents(CLI::App& verb) {
  auto options = std::make_shared<EventsOptions>();
  verb.add_option("--kind", options->kind,
                  "Only requests that were denied, or only acts of organisers: denied or act "
                  "(default: both)")
      ->check(CLI::IsMember({"denied", "act"}));
  verb.add_option("--limit", options->limit, "Rows to show, 1 to 1000 (default: 100)")
      ->check(CLI::Range(1, 1000));
  verb.add_option("--before", options->before, "Only rows with a lower id")
      ->check(CLI::Range(int64_t{1}, INT64_MAX));
  AddDaemonOptions(verb, "events", *options);
  return [options] { return Events(*options); };
}

}  // namespace myograde::server
