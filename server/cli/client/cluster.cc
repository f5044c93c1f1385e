// myograde cluster: nodes, drain, admit
#include <iostream>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

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

struct ClusterOptions : DaemonOptions {
  std::string node;
  std::string reason;
};

void PrintNodes(const Json& answer) {
  const Json nodes = answer.value("nodes", Json::array());
  if (!answer.value("cluster", false)) {
    std::cout << "Leases run on the daemon's host, not on a cluster; \"executor\" of server.json "
                 "says where." << std::endl;
    return;
  }
  if (answer.contains("message") && answer["message"].is_string()) {
    std::cout << Bold(Cell(answer, "message")) << '\n';
  }
  if (nodes.empty()) {
    std::cout << "No node has had a lease since the daemon started, and none is drained."
              << std::endl;
  } else {
    Table table({"node", "state", "running", "done", "faults", "processor", "reason", "by"});
    for (const Json& node : nodes) {
      table.Add({Cell(node, "node"), Cell(node, "state"), Cell(node, "running"),
                 Cell(node, "done"), Cell(node, "faults"), Cell(node, "processor"),
                 Cell(node, "reason"), Cell(node, "drained_by")});
    }
    table.Print();
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

void PrintState(const Json& answer) {
  std::cout << "Node " << Cell(answer, "node")
            << (answer.value("state", "") == "drained"
                    ? " gets no more leases; those that run there go on."
                    : " gets leases again, once it has proved itself.")
            << std::endl;
}

int ListNodes(const ClusterOptions& options) {
  return PrintAnswer(options.client().Get("/v1/nodes"), options.json, PrintNodes);
}

int SetNode(const ClusterOptions& options, const Json& body) {
  return PrintAnswer(options.client().Post(absl::StrCat("/v1/nodes/", options.node), body),
                     options.json, PrintState);
}

int Drain(const ClusterOptions& options) {
  return SetNode(options, {{"state", "drained"}, {"reason", options.reason}});
}

int Admit(const ClusterOptions& options) { return SetNode(options, {{"state", "admitted"}}); }

std::string CheckNodeName(const std::string& text) {
  constexpr char kAlphanumeric[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
  const bool fits = text.size() <= 255 && text.find_first_of(kAlphanumeric) == 0 &&
                    text.find_first_not_of(absl::StrCat(kAlphanumeric, "._-")) == std::string::npos;
  return fits ? std::string()
              : "\"" + text + "\" is no node's name, as \"myograde cluster nodes\" lists them";
}

}  // namespace

Action AddCluster(CLI::App& verb) {
  auto options = std::make_shared<ClusterOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  const auto add = [&](const char* name, const char* does, const char* example, const char* schema,
                       int (*action)(const ClusterOptions&)) {
    CLI::App* part = verb.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde cluster ", example));
    part->callback([=] { *chosen = [=] { return action(*options); }; });
    AddDaemonOptions(*part, schema, *options);
    return part;
  };
  const auto add_node = [&](CLI::App* part) {
    part->add_option("NODE", options->node, "The node, as the cluster names it")
        ->required()
        ->type_name("TEXT")
        ->check(CheckNodeName);
  };
  add("nodes", "List the nodes that had leases, and those that are drained", "nodes",
      "cluster-nodes", ListNodes);
  CLI::App* drain = add("drain", "Start no more leases on a node; those that run there go on",
                        "drain node17 --reason \"a fan is broken\"", "cluster-node", Drain);
  add_node(drain);
  drain->add_option("--reason", options->reason, "Why, for those who list the nodes")->required();
  add_node(add("admit", "Let a node have leases again, once it has proved itself",
               "admit node17", "cluster-node", Admit));
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
