// What operators look after: myograde events; webhook: list, test; cluster: nodes, drain, admit
#include <absl/strings/str_cat.h>

#include <iostream>
#include <memory>
#include <string>

#include "protocol/base/status_macros.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

struct EventsOptions : DaemonOptions {
  std::string kind;
  int64_t limit = 100;
  int64_t before = 0;  // 0: not given
};

void PrintEvents(const Json& answer) {
  PrintList(answer, "events", "Nothing was denied, and no organiser did anything.",
            {"id", "at", "kind", "who", "role", "action", "subject", "detail", "times=count"});
  if (answer.contains("next_before") && answer["next_before"].is_number()) {
    std::cout << "Older ones: --before " << Cell(answer, "next_before") << std::endl;
  }
}

absl::StatusOr<int> Events(const EventsOptions& options) {
  std::string path = absl::StrCat("/v1/events?limit=", options.limit);
  if (options.before != 0) absl::StrAppend(&path, "&before=", options.before);
  if (!options.kind.empty()) absl::StrAppend(&path, "&kind=", options.kind);
  return options.GetAndPrint(path, PrintEvents);
}

constexpr char kAlphanumeric[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";

// A check of names of 1 to `most` letters, digits, ".", "_" and "-", which begin with one of
// `first`.
CLI::Validator PlainName(size_t most, const std::string& first, const std::string& what) {
  return CLI::Validator(
      [=](const std::string& text) {
        const bool fits =
            text.size() <= most && text.find_first_of(first) == 0 &&
            text.find_first_not_of(absl::StrCat(kAlphanumeric, "._-")) == std::string::npos;
        return fits ? "" : absl::StrCat("\"", text, "\" is no ", what);
      },
      "");
}

struct WebhookOptions : DaemonOptions {
  std::string name;
};

void PrintWebhooks(const Json& answer) {
  const Json webhooks = answer.value("webhooks", Json::array());
  if (webhooks.empty()) {
    std::cout << "There are no webhooks; \"webhooks\" of server.json names them." << std::endl;
  }
  for (const Json& webhook : webhooks) {
    std::cout << Cell(webhook, "webhook") << " at " << Cell(webhook, "url") << ": "
              << Cell(webhook, "waiting") << " waiting, " << Cell(webhook, "delivered")
              << " delivered, " << Cell(webhook, "given_up") << " given up" << std::endl;
    const Json deliveries = webhook.value("deliveries", Json::array());
    if (deliveries.empty()) continue;
    PrintRows(deliveries, {"delivery", "event", "at", "state", "attempts",
                           "next attempt=next_attempt_at", "problem"});
  }
  PrintUnreadable(answer);
}

absl::StatusOr<int> TestWebhook(const WebhookOptions& options) {
  ASSIGN_OR_RETURN(
      const Json answer,
      options.client().Post(absl::StrCat("/v1/webhooks/", options.name, "/test"), Json::object()));
  const bool delivered = answer.value("delivered", false);
  if (options.json) {
    PrintJson(answer);
  } else if (delivered) {
    std::cout << "Webhook " << Harmless(options.name) << " took the event \"test\" (status "
              << Cell(answer, "status") << ")." << std::endl;
  } else {
    std::cout << "Webhook " << Harmless(options.name)
              << " did not take the event \"test\": " << Cell(answer, "problem") << "."
              << std::endl;
  }
  return delivered ? kDone : kNoScore;
}

struct ClusterOptions : DaemonOptions {
  std::string node;
  std::string reason;
};

void PrintNodes(const Json& answer) {
  if (!answer.value("cluster", false)) {
    std::cout << "Leases run on the daemon's host, not on a cluster; \"executor\" of server.json "
                 "says where."
              << std::endl;
    return;
  }
  if (answer.contains("message") && answer["message"].is_string()) {
    std::cout << Bold(Cell(answer, "message")) << '\n';
  }
  PrintList(answer, "nodes",
            "No node has had a lease since the daemon started, and none is drained.",
            {"node", "state", "running", "done", "faults", "processor", "reason", "by=drained_by"});
}

absl::StatusOr<int> SetNode(const ClusterOptions& options, const Json& body) {
  return options.PostAndPrint(
      absl::StrCat("/v1/nodes/", options.node), body, [](const Json& answer) {
        std::cout << "Node " << Cell(answer, "node")
                  << (answer.value("state", "") == "drained"
                          ? " gets no more leases; those that run there go on."
                          : " gets leases again, once it has proved itself.")
                  << std::endl;
      });
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

Action AddWebhook(CLI::App& verb) {
  DaemonParts<WebhookOptions> parts(verb);
  parts.Add("list", "List the webhooks and their latest deliveries", "list", "webhooks",
            [](const WebhookOptions& options) {
              return options.GetAndPrint("/v1/webhooks", PrintWebhooks);
            });
  parts
      .Add("test", "Send an event \"test\" to a webhook, once", "test chat", "webhook-test",
           TestWebhook)
      ->add_option("NAME", parts.options().name, "The webhook, as server.json names it")
      ->required()
      ->type_name("TEXT")
      ->check(PlainName(64, absl::StrCat(kAlphanumeric, "._-"),
                        "webhook's name, as \"myograde webhook list\" lists them"));
  return parts.Chosen();
}

Action AddCluster(CLI::App& verb) {
  DaemonParts<ClusterOptions> parts(verb);
  const auto add_node = [&](CLI::App* part) {
    part->add_option("NODE", parts.options().node, "The node, as the cluster names it")
        ->required()
        ->type_name("TEXT")
        ->check(
            PlainName(255, kAlphanumeric, "node's name, as \"myograde cluster nodes\" lists them"));
  };
  parts.Add("nodes", "List the nodes that had leases, and those that are drained", "nodes",
            "cluster-nodes", [](const ClusterOptions& options) {
              return options.GetAndPrint("/v1/nodes", PrintNodes);
            });
  CLI::App* drain =
      parts.Add("drain", "Start no more leases on a node; those that run there go on",
                "drain node17 --reason \"a fan is broken\"", "cluster-node",
                [](const ClusterOptions& options) {
                  return SetNode(options, {{"state", "drained"}, {"reason", options.reason}});
                });
  add_node(drain);
  drain->add_option("--reason", parts.options().reason, "Why, for those who list the nodes")
      ->required();
  add_node(parts.Add("admit", "Let a node have leases again, once it has proved itself",
                     "admit node17", "cluster-node", [](const ClusterOptions& options) {
                       return SetNode(options, {{"state", "admitted"}});
                     }));
  return parts.Chosen();
}

}  // namespace myograde::server
