// myograde webhook: list, test
#include <iostream>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
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

struct WebhookOptions : DaemonOptions {
  std::string name;
};

void PrintDeliveries(const Json& webhook) {
  const Json deliveries = webhook.value("deliveries", Json::array());
  if (deliveries.empty()) return;
  Table table({"delivery", "event", "at", "state", "attempts", "next attempt", "problem"});
  for (const Json& delivery : deliveries) {
    table.Add({Cell(delivery, "delivery"), Cell(delivery, "event"), Cell(delivery, "at"),
               Cell(delivery, "state"), Cell(delivery, "attempts"),
               Cell(delivery, "next_attempt_at"), Cell(delivery, "problem")});
  }
  table.Print();
}

void PrintWebhooks(const Json& answer) {
  const Json webhooks = answer.value("webhooks", Json::array());
  if (webhooks.empty()) {
    std::cout << "There are no webhooks; \"webhooks\" of server.json names them." << std::endl;
  }
  for (const Json& webhook : webhooks) {
    std::cout << Cell(webhook, "webhook") << " at " << Cell(webhook, "url") << ": "
              << Cell(webhook, "waiting") << " waiting, " << Cell(webhook, "delivered")
              << " delivered, " << Cell(webhook, "given_up") << " given up" << std::endl;
    PrintDeliveries(webhook);
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

int ListWebhooks(const WebhookOptions& options) {
  return PrintAnswer(options.client().Get("/v1/webhooks"), options.json, PrintWebhooks);
}

int TestWebhook(const WebhookOptions& options) {
  const absl::StatusOr<Json> answer = options.client().Post(
      absl::StrCat("/v1/webhooks/", options.name, "/test"), Json::object());
  if (!answer.ok()) return ReportError(answer.status());
  const bool delivered = answer->value("delivered", false);
  if (options.json) {
    PrintJson(*answer);
  } else if (delivered) {
    std::cout << "Webhook " << Harmless(options.name) << " took the event \"test\" (status "
              << Cell(*answer, "status") << ")." << std::endl;
  } else {
    std::cout << "Webhook " << Harmless(options.name) << " did not take the event \"test\": "
              << Cell(*answer, "problem") << "." << std::endl;
  }
  return delivered ? kDone : kNoScore;
}

}  // namespace

Action AddWebhook(CLI::App& verb) {
  auto options = std::make_shared<WebhookOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  const auto add = [&](const char* name, const char* does, const char* example, const char* schema,
                       int (*action)(const WebhookOptions&)) {
    CLI::App* part = verb.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde webhook ", example));
    part->callback([=] { *chosen = [=] { return action(*options); }; });
    AddDaemonOptions(*part, schema, *options);
    return part;
  };
  add("list", "List the webhooks and their latest deliveries", "list", "webhooks", ListWebhooks);
  CLI::App* test = add("test", "Send an event \"test\" to a webhook, once", "test chat",
                       "webhook-test", TestWebhook);
  test->add_option("NAME", options->name, "The webhook, as server.json names it")
      ->required()
      ->type_name("TEXT")
      ->check([](const std::string& text) {
        const bool fits = !text.empty() && text.size() <= 64 &&
                          text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                                 "0123456789._-") == std::string::npos;
        return fits ? std::string()
                    : "\"" + text + "\" is no webhook's name, as \"myograde webhook list\" lists them";
      });
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
