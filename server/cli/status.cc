// myograde status, myograde cancel
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/report.h"
#include "server/cli/terminal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct StatusOptions {
  ApiOptions daemon;
  int64_t id = 0;  // 0: all
  std::string reason;
  bool json = false;
};

void PrintLeases(const Json& leases) {
  Table table({"lease", "episodes", "state", "slot", "attempt", "at episode", "step"});
  for (const Json& lease : leases) {
    table.Add({Cell(lease, "lease"), Cell(lease, "first") + ".." + Cell(lease, "last"),
               Cell(lease, "state"), Cell(lease, "slot"), Cell(lease, "attempt"),
               Cell(lease, "episode"), Cell(lease, "step")});
  }
  table.Print();
}

void PrintStatus(const Json& status) {
  std::cout << Bold(absl::StrCat("Submission ", Cell(status, "submission"), ": ",
                                 Cell(status, "state")))
            << '\n'
            << "  " << Cell(status, "name") << " of " << Cell(status, "team") << ", "
            << Cell(status, "track") << " in the profile " << Cell(status, "profile")
            << (status.value("ranked", false) ? "" : " (practice)") << '\n'
            << "  " << CountsText(status.value("episodes", Json::object())) << '\n';
  const Json queue = status.value("queue", Json());
  if (queue.is_object()) {
    std::cout << "  place " << Cell(queue, "position") << " in the queue, behind "
              << Cell(queue, "leases_ahead") << " leases\n";
  }
  for (const char* key : {"waiting", "reason"}) {
    if (status.contains(key) && status[key].is_string()) {
      std::cout << "  " << Cell(status, key) << '\n';
    }
  }
  if (status.contains("running_wall_s") && status["running_wall_s"].is_number()) {
    std::cout << "  running for " << Span(status["running_wall_s"].get<double>());
    if (status.contains("remaining_wall_s") && status["remaining_wall_s"].is_number()) {
      std::cout << ", about " << Span(status["remaining_wall_s"].get<double>()) << " left";
    }
    std::cout << '\n';
  }
  PrintLeases(status.value("leases", Json::array()));
}

int StatusOfAll(const Client& client, bool json) {
  const absl::StatusOr<Json> health = client.Get("/v1/health");
  if (!health.ok()) return Complain(health.status());
  const absl::StatusOr<Json> list = client.Get("/v1/submissions");
  if (!list.ok()) return Complain(list.status());
  const Json submissions = list->value("submissions", Json::array());
  if (json) {
    PrintJson({{"daemon", *health}, {"submissions", submissions}});
    return kDone;
  }
  std::cout << "The daemon (" << Cell(*health, "version") << ", process " << Cell(*health, "pid")
            << ") is " << Cell(*health, "status") << ": " << Cell(*health, "running") << " of "
            << Cell(*health, "slots") << " slots at work, " << Cell(*health, "pending_leases")
            << " leases waiting\n";
  if (submissions.empty()) {
    std::cout << "There are no submissions yet." << std::endl;
    return kDone;
  }
  Table table({"id", "team", "track", "profile", "state", "done", "of", "successes", "faults"});
  for (const Json& row : submissions) {
    const Json counts = row.value("episodes", Json::object());
    table.Add({Cell(row, "submission"), Cell(row, "team"), Cell(row, "track"),
               Cell(row, "profile"), Cell(row, "state"), Cell(counts, "done"),
               Cell(counts, "total"), Cell(counts, "success"), Cell(counts, "fault")});
  }
  table.Print();
  return kDone;
}

int Status(const StatusOptions& options) {
  const Client client(options.daemon.path());
  if (options.id == 0) return StatusOfAll(client, options.json);
  const absl::StatusOr<Json> status = client.Get(absl::StrCat("/v1/submissions/", options.id));
  if (!status.ok()) return Complain(status.status());
  if (options.json) {
    PrintJson(*status);
  } else {
    PrintStatus(*status);
  }
  return kDone;
}

int Cancel(const StatusOptions& options) {
  const Client client(options.daemon.path());
  Json body = Json::object();
  if (!options.reason.empty()) body["reason"] = options.reason;
  const absl::StatusOr<Json> status =
      client.Post(absl::StrCat("/v1/submissions/", options.id, "/cancel"), body);
  if (!status.ok()) return Complain(status.status());
  if (options.json) {
    PrintJson(*status);
  } else {
    std::cout << "Submission " << options.id << " is " << Cell(*status, "state") << "; "
              << CountsText(status->value("episodes", Json::object())) << " are kept." << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddStatus(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  verb.add_option("ID", options->id, "A submission (default: the daemon and its newest 100)")
      ->check(CLI::PositiveNumber);
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/status.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Status(*options); };
}

Action AddCancel(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  verb.add_option("ID", options->id, "The submission")->required()->check(CLI::PositiveNumber);
  verb.add_option("--reason", options->reason, "Why, for the record; up to 200 bytes");
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/cancel.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Cancel(*options); };
}

}  // namespace myograde::server
