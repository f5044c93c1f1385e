// myograde status, myograde cancel
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/report.h"
#include "server/cli/table.h"
#include "server/cli/terminal.h"
#include "server/base/counted.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct StatusOptions {
  ApiOptions daemon;
  int64_t id = 0;  // 0: all
  std::string reason;
  bool json = false;
};

std::string RunningFor(const Json& lease) {
  const Json time = lease.value("running_wall_s", Json());
  return time.is_number() ? Span(time.get<double>()) : "-";
}

// A time of the API to the second: "2026-11-22 02:10:54 UTC".
std::string Moment(const Json& time) {
  std::string text = time.is_string() ? Harmless(time.get<std::string>()) : "-";
  if (text.size() < 19 || text[10] != 'T') return text;
  text[10] = ' ';
  return text.substr(0, 19) + " UTC";
}

// Participants call a lease a block of episodes.
void PrintLeases(const Json& leases) {
  Table table({"block", "episodes", "state", "host", "slot", "attempt", "running", "at episode",
               "step"});
  for (const Json& lease : leases) {
    table.Add({Cell(lease, "lease"), Cell(lease, "first") + ".." + Cell(lease, "last"),
               Cell(lease, "state"), Cell(lease, "host"), Cell(lease, "slot"),
               Cell(lease, "attempt"), RunningFor(lease),
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
              << CountedBlocks(queue.value("leases_ahead", int64_t{0})) << '\n';
  }
  for (const char* key : {"waiting", "reason"}) {
    if (status.contains(key) && status[key].is_string()) {
      std::cout << "  " << Cell(status, key) << '\n';
    }
  }
  const bool running = status.contains("running_wall_s") && status["running_wall_s"].is_number();
  const bool known = status.contains("remaining_wall_s") && status["remaining_wall_s"].is_number();
  if (running) {
    std::cout << "  " << (Cell(status, "finished_at") == "-" ? "running" : "ran") << " for "
              << Span(status["running_wall_s"].get<double>()) << '\n';
  }
  if (known) {
    std::cout << "  about " << Span(status["remaining_wall_s"].get<double>())
              << " left, estimated end " << Moment(status["estimated_end_at"]) << '\n';
  }
  if (status.contains("deadline_at") && status["deadline_at"].is_string()) {
    std::cout << "  if nothing happens until " << Moment(status["deadline_at"])
              << ", the daemon steps in by itself\n";
  }
  PrintLeases(status.value("leases", Json::array()));
}

void PrintSlots(const Json& health) {
  const Json leases = health.value("leases", Json::array());
  if (leases.empty()) return;
  Table table({"slot", "submission", "block", "running", "at episode", "step"});
  for (const Json& lease : leases) {
    table.Add({Cell(lease, "slot"), Cell(lease, "submission"), Cell(lease, "lease"),
               RunningFor(lease), Cell(lease, "episode"), Cell(lease, "step")});
  }
  table.Print();
}

int StatusOfAll(const Client& client, bool json) {
  const absl::StatusOr<Json> health = client.Get("/v1/health");
  if (!health.ok()) return Complain(health.status());
  const absl::StatusOr<Json> list = client.Get("/v1/submissions");
  if (!list.ok()) return Complain(list.status());
  const Json submissions = list->value("submissions", Json::array());
  if (json) {
    PrintJson({{"daemon", *health},
               {"submissions", submissions},
               {"unreadable", list->value("unreadable", Json::array())}});
    return kDone;
  }
  const std::string state = Cell(*health, "status");
  std::cout << "The daemon (" << Cell(*health, "version") << ", process " << Cell(*health, "pid")
            << (state == "store" ? ") can't write its store" : absl::StrCat(") is ", state)) << ": "
            << Cell(*health, "running") << " of " << CountCell(*health, "slots", "slot")
            << " at work, " << CountedBlocks(health->value("pending_leases", int64_t{0}))
            << " waiting\n";
  if (health->contains("message") && (*health)["message"].is_string()) {
    std::cout << Bold(Cell(*health, "message")) << '\n';
  }
  PrintSlots(*health);
  PrintUnreadable(*health);
  PrintUnreadable(*list);
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

// What the kill did, in words.
std::string KillText(const Json& kill) {
  const int64_t killed = kill.value("killed", int64_t{0});
  if (killed == 0) return "nothing of it was running";
  const std::string took = absl::StrFormat("%.2f s", kill.value("took_wall_s", 0.0));
  std::string text =
      killed == 1 ? absl::StrCat("its running block of episodes was killed within ", took)
                  : absl::StrCat("its ", killed, " running blocks of episodes were killed within ",
                                 took);
  if (const int64_t left = kill.value("still_ending", int64_t{0}); left > 0) {
    absl::StrAppend(&text, " (", left, " not dead yet; the slot stays taken until then)");
  }
  return text;
}

// What became of the team's quota, in words; "" if the daemon does not tell.
std::string QuotaText(const Json& status) {
  const Json cancel = status.value("cancel", Json::object());
  if (!cancel.contains("charged")) return "";
  if (!cancel["charged"].is_string()) {
    return " Nothing of the team's quota is used up: no episode of it had ended.";
  }
  return absl::StrCat(" It stays charged to the team's quota, as one ",
                      Cell(cancel, "charged") == "practice" ? "practice" : "official",
                      " evaluation: cancelling gives nothing back.");
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
              << KillText(status->value("cancel", Json::object())) << "; it keeps "
              << CountsText(status->value("episodes", Json::object())) << "."
              << QuotaText(*status) << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddStatus(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  AddSubmissionId(verb, options->id, /*required=*/false,
                  "A submission (default: the daemon and its newest 100)");
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/status.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Status(*options); };
}

Action AddCancel(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  AddSubmissionId(verb, options->id);
  verb.add_option("--reason", options->reason, "Why, for the record; up to 200 bytes");
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/cancel.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Cancel(*options); };
}

}  // namespace myograde::server
