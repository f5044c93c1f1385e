// What organisers and operators do: myograde phase: pause, resume, publish; evaluate: further
// episodes for places that are close; events; webhook: list, test; cluster: nodes, drain, admit
#include <absl/strings/str_cat.h>

#include <iostream>
#include <memory>
#include <string>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/report.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

struct PhaseOptions : DaemonOptions {
  std::string name;
  std::string reason;
  bool all = false;
};

void PrintAct(const Json& answer) {
  const bool all = answer.value("phase", Json()).is_null();
  const std::string event = Cell(answer, "event");
  const bool changed = answer.value("changed", false);
  std::cout << Filled(answer, all ? "Submissions are " : "Phase {phase} is ")
            << (event == "resumed" ? (changed ? "no longer paused" : "not paused")
                                   : (changed ? "now " : "already ") + event)
            << (changed ? "." : "; nothing changed.");
  if (event == "resumed" && Cell(answer, "state") == "paused") {
    std::cout << " It stays paused, as all submissions are.";
  }
  std::cout << std::endl;
}

// `act`: "pause", "resume" or "publish".
absl::StatusOr<int> ActOnPhase(const PhaseOptions& options, const std::string& act) {
  RETURN_IF_ERROR(RefuseIf({{options.all == !options.name.empty(),
                             "name one phase, or give --all for all submissions"}}));
  const std::string of = options.all ? "" : absl::StrCat("phases/", QueryValue(options.name), "/");
  return options.PostAndPrint(absl::StrCat("/v1/", of, act), {{"reason", options.reason}},
                              PrintAct);
}

struct EvaluateOptions : DaemonOptions {
  std::string phase;
  std::string board = "main";
  int64_t more_seeds = 0;
  std::string places;  // "A..B", or "" for all that are undecided
  std::string reason = "close places";
  bool wait = false;
};

absl::StatusOr<Json> PlacesOf(const std::string& text) {
  const auto range = ParseRange(text);
  if (range.has_value() && range->first >= 1 && range->second > range->first) {
    return Json{range->first, range->second};
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--places: \"", Harmless(text), "\" is not two ranks as in 2..4"));
}

void PrintFurther(const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const Json submissions = rejudge.value("submissions", Json::array());
    std::cout << Filled(rejudge, "Rejudge {rejudge} plays {episodes:further episode} of ")
              << Counted(std::ssize(submissions), "submission") << ":";
    for (const Json& submission : submissions) std::cout << ' ' << submission;
    std::cout << "\n";
    const Json lost = rejudge.value("without_files", Json::array());
    if (!lost.empty()) {
      std::cout << "  The files of " << Counted(std::ssize(lost), "submission")
                << " are not on this host any more, so it gets none.\n";
    }
  }
  std::cout << Filled(answer, "No rank by the rules changes. Once they have ended, \"myograde "
                              "leaderboard --phase {phase} --statistics\" takes them in.")
            << std::endl;
}

absl::StatusOr<int> Evaluate(const EvaluateOptions& options) {
  Json body = {
      {"episodes", options.more_seeds}, {"board", options.board}, {"reason", options.reason}};
  if (!options.places.empty()) {
    ASSIGN_OR_RETURN(body["places"], PlacesOf(options.places));
  }
  const Client client = options.client();
  ASSIGN_OR_RETURN(
      const Json asked,
      client.Post(absl::StrCat("/v1/phases/", QueryValue(options.phase), "/more-seeds"), body));
  // Until all of them have been played, or were dropped.
  for (const Json& rejudge : options.wait ? asked.value("rejudges", Json()) : Json()) {
    RETURN_IF_ERROR(FollowUntil(client, Filled(rejudge, "/v1/rejudges/{rejudge}"),
                                Filled(rejudge, "rejudge {rejudge}"),
                                [](const Json& now) {
                                  return now.value("complete", false) ||
                                         now.value("state", "") == "dropped";
                                })
                        .status());
  }
  return PrintAnswer(asked, options.json, PrintFurther);
}

struct EventsOptions : DaemonOptions {
  std::string kind;
  int64_t limit = 100;
  int64_t before = 0;  // 0: not given
};

void PrintEvents(const Json& answer) {
  PrintList(answer, "events", "Nothing was denied, and no organiser did anything.",
            {"id", "at", "kind", "who", "role", "action", "subject", "detail", "times=count"});
  std::cout << Filled(answer, "[Older ones: --before {next_before}\n]");
}

absl::StatusOr<int> Events(const EventsOptions& options) {
  const std::string before = options.before == 0 ? "" : absl::StrCat(options.before);
  return options.GetAndPrint("/v1/events" + QueryOf({{"limit", absl::StrCat(options.limit)},
                                                     {"before", before},
                                                     {"kind", options.kind}}),
                             PrintEvents);
}

// A check by IsSimpleName; `what` says in the error what the text is not.
CLI::Validator NameOf(size_t most, bool any_first, const std::string& what) {
  return CLI::Validator(
      [=](const std::string& text) {
        return IsSimpleName(text, most, any_first) ? ""
                                                  : absl::StrCat("\"", text, "\" is no ", what);
      },
      "");
}

struct WebhookOptions : DaemonOptions {
  std::string name;
};

void PrintWebhooks(const Json& answer) {
  const Json webhooks = answer.value("webhooks", Json::array());
  if (webhooks.empty()) {
    std::cout << "There are no webhooks; \"webhooks\" of server.json names them.\n";
  }
  for (const Json& webhook : webhooks) {
    std::cout << Filled(webhook, "{webhook} at {url}: {waiting} waiting, {delivered} delivered, "
                                 "{given_up} given up\n");
    const Json deliveries = webhook.value("deliveries", Json::array());
    if (deliveries.empty()) continue;
    PrintRows(deliveries, {"delivery", "event", "at", "state", "attempts",
                           "next attempt=next_attempt_at", "problem"});
  }
}

absl::StatusOr<int> TestWebhook(const WebhookOptions& options) {
  ASSIGN_OR_RETURN(
      const Json answer,
      options.client().Post(absl::StrCat("/v1/webhooks/", options.name, "/test"), Json::object()));
  const bool delivered = answer.value("delivered", false);
  return PrintAnswer(
      answer, options.json,
      Sentence(absl::StrCat("Webhook ", options.name,
                            delivered ? " took the event \"test\" (status {status})."
                                      : " did not take the event \"test\": {problem}.")),
      delivered ? kDone : kNoScore);
}

struct ClusterOptions : DaemonOptions {
  std::string node;
  std::string reason;
};

void PrintNodes(const Json& answer) {
  if (!answer.value("cluster", false)) {
    std::cout << "Leases run on the daemon's host, not on a cluster; \"executor\" of server.json "
                 "says where.\n";
    return;
  }
  if (!TextAt(answer, "message").empty()) std::cout << Bold(Cell(answer, "message")) << '\n';
  PrintList(answer, "nodes",
            "No node has had a lease since the daemon started, and none is drained.",
            {"node", "state", "running", "done", "faults", "processor", "reason", "by=drained_by"});
}

}  // namespace

Action AddPhase(CLI::App& verb) {
  DaemonParts<PhaseOptions> parts(verb);
  const auto add = [&](const std::string& name, const char* does, const char* example, bool all) {
    CLI::App* part = parts.Add(name, does, example, "phase", [name](const PhaseOptions& options) {
      return ActOnPhase(options, name);
    });
    part->add_option("NAME", parts.options().name,
                     "The phase, as \"myograde challenge status\" lists it");
    part->add_option("--reason", parts.options().reason,
                     "Why, for those who submit and for the record; up to 200 bytes")
        ->required();
    if (!all) return;
    part->add_flag("--all", parts.options().all, "All submissions, of every track and phase");
  };
  add("pause", "Refuse submissions for now; those that were accepted are played",
      "pause final --reason \"a slot is broken\"", /*all=*/true);
  add("resume", "Accept submissions again", "resume final --reason \"it is repaired\"",
      /*all=*/true);
  add("publish", "Show everybody a frozen board, and what the phase withheld; can't be undone",
      "publish final --reason \"closing ceremony\"", /*all=*/false);
  return parts.Chosen();
}

Action AddEvaluate(CLI::App& verb) {
  auto options = std::make_shared<EvaluateOptions>();
  verb.add_option("--phase", options->phase, "The phase whose places are close")->required();
  verb.add_option("--more-seeds", options->more_seeds,
                  "Further episodes of each submission in total, on seeds that follow the "
                  "phase's own")
      ->required()
      ->type_name("N");
  verb.add_option("--places", options->places,
                  "First and last rank (default: all that share a group)")
      ->type_name("A..B");
  verb.add_option("--board", options->board, "Name of the board (default: main)");
  verb.add_option("--reason", options->reason,
                  "Why, for the record; up to 200 bytes (default: \"close places\")");
  verb.add_flag("--wait", options->wait, "Wait until they have been played");
  AddDaemonOptions(verb, "evaluate", *options);
  return [options] { return Evaluate(*options); };
}

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
      ->check(NameOf(64, /*any_first=*/true,
                     "webhook's name, as \"myograde webhook list\" lists them"));
  return parts.Chosen();
}

Action AddCluster(CLI::App& verb) {
  DaemonParts<ClusterOptions> parts(verb);
  const auto add_node = [&](CLI::App* part) {
    part->add_option("NODE", parts.options().node, "The node, as the cluster names it")
        ->required()
        ->type_name("TEXT")
        ->check(NameOf(255, /*any_first=*/false,
                       "node's name, as \"myograde cluster nodes\" lists them"));
  };
  parts.Add("nodes", "List the nodes that had leases, and those that are drained", "nodes",
            "cluster-nodes", [](const ClusterOptions& options) {
              return options.GetAndPrint("/v1/nodes", PrintNodes);
            });
  CLI::App* drain =
      parts.Add("drain", "Start no more leases on a node; those that run there go on",
                "drain node17 --reason \"a fan is broken\"", "cluster-node",
                [](const ClusterOptions& options) {
                  return options.PostAndPrint(
                      "/v1/nodes/" + options.node,
                      {{"state", "drained"}, {"reason", options.reason}},
                      Sentence("Node {node} gets no more leases; those that run there go on."));
                });
  add_node(drain);
  drain->add_option("--reason", parts.options().reason, "Why, for those who list the nodes")
      ->required();
  add_node(parts.Add("admit", "Let a node have leases again, once it has proved itself",
                     "admit node17", "cluster-node", [](const ClusterOptions& options) {
                       return options.PostAndPrint(
                           "/v1/nodes/" + options.node, {{"state", "admitted"}},
                           Sentence("Node {node} gets leases again, once it has proved itself."));
                     }));
  return parts.Chosen();
}

}  // namespace myograde::server
