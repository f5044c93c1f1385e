// What the daemon does: myograde status; events; webhook: list, test; cluster: nodes, drain, admit
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <absl/time/time.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <string>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kStartTime = absl::Minutes(5);  // of a daemon
constexpr absl::Duration kReadyPoll = absl::Milliseconds(100);

std::string DurationAt(const Json& object, const char* key) {
  const Json time = object.value(key, Json());
  return time.is_number() ? DurationText(time.get<double>()) : "-";
}

std::string RunningFor(const Json& lease) { return DurationAt(lease, "running_wall_s"); }

// A time of the API to the second: "2026-11-22 02:10:54 UTC".
std::string Moment(const Json& object, const char* key) {
  std::string text = Cell(object, key);
  if (text.size() < 19 || text[10] != 'T') return text;
  text[10] = ' ';
  return text.substr(0, 19) + " UTC";
}

// Whether any of them runs as a job of a cluster.
bool OnCluster(const Json& leases) {
  return std::any_of(leases.begin(), leases.end(),
                     [](const Json& lease) { return lease.value("job", Json()).is_string(); });
}

bool Waits(const Json& lease) {
  const Json begun = lease.value("begun", Json());
  return begun.is_boolean() && !begun.get<bool>();
}

void PrintBlocks(const Json& blocks) {
  const auto state = [](const Json& lease) {
    return Waits(lease) ? "waits for a node" : Cell(lease, "state");
  };
  PrintRows(blocks, {"block", "episodes={first}..{last}", RowColumn("state", state),
                     "host", OnCluster(blocks) ? "job" : "slot", "attempt",
                     RowColumn("running", RunningFor), "at episode=episode", "step"});
}

// A duration that may be 0 for "not known".
std::string UsedFor(const Json& attempt) {
  return attempt.value("cpu_s", Json()) == 0 ? "-" : DurationAt(attempt, "cpu_s");
}

std::string ReadEnergy(const Json& attempt) {
  const Json energy = attempt.value("energy_j", Json());
  return energy.is_number() ? absl::StrCat(std::llround(energy.get<double>()), " J") : "-";
}

// Where the attempts that have ended were played, and what they used, and what was last wrong with each
// block; nothing of attempts on the daemon's host that ended well, which say no more than their block.
void PrintAttempts(const Json& blocks) {
  Json told = Json::array();
  for (const Json& block : blocks) {
    for (Json attempt : block.value("attempts", Json::array())) {
      if (Cell(attempt, "job") == "-" && Cell(attempt, "how") == "done") continue;
      attempt["block"] = block.value("block", Json());
      told.push_back(std::move(attempt));
    }
  }
  if (!told.empty()) {
    const auto moment = [](const char* key) {
      return [key](const Json& attempt) { return Moment(attempt, key); };
    };
    std::cout << "\nAttempts that have ended:\n";
    PrintRows(told, {"block", "attempt", "node", "job", RowColumn("began", moment("began_at")),
                     RowColumn("ended", moment("ended_at")), RowColumn("CPU time", UsedFor),
                     RowColumn("energy", ReadEnergy), "how"});
  }
  for (const Json& block : blocks) {
    if (Cell(block, "detail") == "-" || Cell(block, "state") == "cancelled") continue;
    std::cout << Filled(block, "Block {block}, last failure: {detail}\n");
  }
}

void PrintStatus(const Json& status) {
  std::cout << Bold(Filled(status, "Submission {submission}: {state}"))
            << Filled(status, "\n  {name} of {team}, {track} in the profile {profile}")
            << (status.value("ranked", false) ? "" : " (practice)") << "\n  " << CountsText(status)
            << '\n';
  const Json queue = status.value("queue", Json());
  if (queue.is_object()) {
    std::cout << Filled(queue, "  place {position} in the queue, behind ")
              << CountedBlocks(queue.value("blocks_ahead", int64_t{0})) << '\n';
  }
  std::cout << Filled(status, "[  {waiting}\n][  {reason}\n]");
  if (const std::string time = DurationAt(status, "running_wall_s"); time != "-") {
    std::cout << (Cell(status, "finished_at") == "-" ? "  running for " : "  ran for ") << time
              << '\n';
  }
  if (const std::string time = DurationAt(status, "remaining_wall_s"); time != "-") {
    std::cout << "  about " << time << " left, estimated end " << Moment(status, "estimated_end_at")
              << '\n';
  }
  if (!TextAt(status, "deadline_at").empty()) {
    std::cout << "  if nothing happens until " << Moment(status, "deadline_at")
              << ", the daemon intervenes\n";
  }
  PrintBlocks(status.value("blocks", Json::array()));
  PrintAttempts(status.value("blocks", Json::array()));
}

void PrintJobs(const Json& leases) {
  const auto waiting = std::count_if(leases.begin(), leases.end(), Waits);
  std::cout << "Jobs: " << std::ssize(leases) - waiting << " running, " << waiting
            << " waiting for a node\n";
  const auto node = [](const Json& lease) { return Waits(lease) ? "waits" : Cell(lease, "node"); };
  PrintRows(leases, {RowColumn("node", node), "job", "submission", "block=lease",
                     RowColumn("running", RunningFor), RowColumn("CPU time", UsedFor),
                     "at episode=episode", "step"});
}

void PrintHealth(const Json& health) {
  // Only organisers see the process, and only participants how busy it is.
  const bool store = Cell(health, "status") == "store";
  std::cout << Filled(health, "The daemon ({version}[, process {pid}])")
            << Filled(health, store ? " can't write its store" : " is {status}");
  if (health.contains("slots")) {
    std::cout << Filled(health, ": {running} of {slots:slot} busy, ")
              << CountedBlocks(health.value("pending_blocks", int64_t{0})) << " waiting";
  }
  std::cout << '\n';
  if (!TextAt(health, "message").empty()) std::cout << Bold(Cell(health, "message")) << '\n';
  const Json leases = health.value("leases", Json::array());
  if (OnCluster(leases)) {
    PrintJobs(leases);
  } else if (!leases.empty()) {
    PrintRows(leases, {"slot", "submission", "block=lease", RowColumn("running", RunningFor),
                       "at episode=episode", "step"});
  }
  for (const Json& artefact : health.value("held_back", Json::array())) {
    if (!artefact.is_string()) continue;
    std::cout << "  Held back: artefact " << Sanitized(artefact.get<std::string>())
              << ": its last evaluations failed by a fault of the grader; \"myograde status\" "
                 "lists them, \"myograde rerun\" plays them again\n";
  }
  PrintUnreadable(health);
}

absl::StatusOr<int> StatusOfAll(const Client& client, bool json) {
  ASSIGN_OR_RETURN(const Json health, client.Get("/v1/health"));
  ASSIGN_OR_RETURN(const Json list, client.Get("/v1/submissions"));
  const Json both = {{"daemon", health}, {"submissions", list.value("submissions", Json::array())}};
  return PrintAnswer(both, json, [&](const Json&) {
    PrintHealth(health);
    PrintList(both, "submissions", "There are no submissions yet.",
              {"id=submission", "team", "track", "profile", "state", "done={episodes.done}",
               "of={episodes.total}", "successes={episodes.success}", "faults={episodes.fault}"});
  });
}

struct StatusOptions : SubmissionOptions {
  bool wait = false;
};

// Until the daemon can take submissions. Its error once it has not been ready for kStartTime.
absl::Status AwaitReady(const Client& client) {
  const Clock& clock = SystemClock();
  const absl::Duration start = clock.Monotonic();
  for (;;) {
    const absl::Status ready = client.Get("/v1/ready").status();
    if (ready.ok() || ready.code() == absl::StatusCode::kInvalidArgument ||
        clock.Monotonic() - start > kStartTime) {
      return ready;
    }
    absl::SleepFor(kReadyPoll);
  }
}

absl::StatusOr<int> Status(const StatusOptions& options) {
  const Client client = options.client();
  if (options.id == 0) {
    if (options.wait) RETURN_IF_ERROR(AwaitReady(client));
    return StatusOfAll(client, options.json);
  }
  if (!options.wait) return PrintAnswer(client.Get(options.Resource()), options.json, PrintStatus);
  ASSIGN_OR_RETURN(const Json ended, FollowUntil(client, options.Resource(),
                                                 absl::StrCat("submission ", options.id)));
  return PrintAnswer(ended, options.json, PrintStatus, ExitOfState(ended.value("state", "")));
}

struct EventsOptions : DaemonOptions {
  std::string kind;
  int64_t limit = 100;
  int64_t before = 0;  // 0: not given
};

void PrintEvents(const Json& answer) {
  PrintList(answer, "events", "No request was denied, and no organiser did anything.",
            {"id", "at", "kind", "who", "role", "action", "subject", "detail", "times=count"});
  std::cout << Filled(answer, "[Older ones: --before {next_before}\n]");
}

absl::StatusOr<int> Events(const EventsOptions& options) {
  const std::string before = options.before == 0 ? "" : absl::StrCat(options.before);
  return options.GetAndPrint("/v1/events" + BuildQuery({{"limit", absl::StrCat(options.limit)},
                                                        {"before", before},
                                                        {"kind", options.kind}}),
                             PrintEvents);
}

// A check by IsSimpleName; `what` says in the error what the text is not.
CLI::Validator NameOf(size_t most, bool any_first, const std::string& what) {
  return CLI::Validator(
      [=](const std::string& text) {
        return IsSimpleName(text, most, any_first) ? ""
                                                  : absl::StrCat("\"", text, "\" is not a ", what);
      },
      "");
}

struct WebhookOptions : DaemonOptions {
  std::string name;
};

void PrintWebhooks(const Json& answer) {
  const Json webhooks = answer.value("webhooks", Json::array());
  if (webhooks.empty()) {
    std::cout << "There are no webhooks; define them under \"webhooks\" of server.json.\n";
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
                            delivered ? " accepted the event \"test\" (status {status})."
                                      : " did not accept the event \"test\": {problem}.")),
      delivered ? kDone : kNoScore);
}

struct ClusterOptions : DaemonOptions {
  std::string node;
  std::string reason;
};

void PrintNodes(const Json& answer) {
  if (!answer.value("cluster", false)) {
    std::cout << "Leases run on the daemon's host, not on a cluster; see \"executor\" of "
                 "server.json.\n";
    return;
  }
  if (!TextAt(answer, "message").empty()) std::cout << Bold(Cell(answer, "message")) << '\n';
  PrintList(answer, "nodes",
            "No node has had a lease since the daemon started, and none is drained.",
            {"node", "state", "running", "done", "faults", "processor", "reason", "by=drained_by"});
}

}  // namespace

Command AddStatus(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  AddSubmissionId(verb, *options, /*required=*/false,
                  "A submission (default: the daemon and its newest 100)");
  verb.add_flag("--wait", options->wait,
                "Wait until the daemon is ready for submissions (5 minutes at most), or with ID "
                "until that submission has ended");
  AddDaemonOptions(verb, "status", *options);
  return [options] { return Status(*options); };
}

Command AddEvents(CLI::App& verb) {
  auto options = std::make_shared<EventsOptions>();
  verb.add_option("--kind", options->kind,
                  "denied: only denied requests; act: only what organisers did (default: both)")
      ->check(CLI::IsMember({"denied", "act"}));
  verb.add_option("--limit", options->limit, "Rows to show, 1 to 1000 (default: 100)")
      ->check(CLI::Range(1, 1000));
  verb.add_option("--before", options->before, "Only rows with a lower id")
      ->check(CLI::Range(int64_t{1}, INT64_MAX));
  AddDaemonOptions(verb, "events", *options);
  return [options] { return Events(*options); };
}

Command AddWebhook(CLI::App& verb) {
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
  return {};
}

Command AddCluster(CLI::App& verb) {
  DaemonParts<ClusterOptions> parts(verb);
  const auto add_node = [&](CLI::App* part) {
    part->add_option("NODE", parts.options().node, "The node, as the cluster names it")
        ->required()
        ->type_name("TEXT")
        ->check(NameOf(255, /*any_first=*/false,
                       "node's name, as \"myograde cluster nodes\" lists them"));
  };
  parts.Add("nodes", "List the nodes that have had leases, and the drained ones", "nodes",
            "cluster-nodes", [](const ClusterOptions& options) {
              return options.GetAndPrint("/v1/nodes", PrintNodes);
            });
  CLI::App* drain =
      parts.Add("drain", "Start no more leases on a node; running ones continue",
                "drain node17 --reason \"a fan is broken\"", "cluster-node",
                [](const ClusterOptions& options) {
                  return options.PostAndPrint(
                      "/v1/nodes/" + options.node,
                      {{"state", "drained"}, {"reason", options.reason}},
                      Sentence("Node {node} gets no more leases; running ones continue."));
                });
  add_node(drain);
  drain->add_option("--reason", parts.options().reason, "Reason, shown in the list of nodes")
      ->required();
  add_node(parts.Add("admit", "Give a node leases again, once it passes its self-test",
                     "admit node17", "cluster-node", [](const ClusterOptions& options) {
                       return options.PostAndPrint(
                           "/v1/nodes/" + options.node, {{"state", "admitted"}},
                           Sentence("Node {node} gets leases again, once it passes its "
                                    "self-test."));
                     }));
  return {};
}

}  // namespace myograde::server
