// myograde status
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
#include "server/cli/base/report.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/text.h"

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

// Participants call a lease a block of episodes.
void PrintLeases(const Json& leases) {
  const auto state = [](const Json& lease) {
    return Waits(lease) ? "waits for a node" : Cell(lease, "state");
  };
  const auto episodes = [](const Json& lease) {
    return Cell(lease, "first") + ".." + Cell(lease, "last");
  };
  PrintRows(leases, {"block=lease", RowColumn("episodes", episodes), RowColumn("state", state),
                     "host", OnCluster(leases) ? "job" : "slot", "attempt",
                     RowColumn("running", RunningFor), "at episode=episode", "step"});
}

// A duration that may be 0 for "not known".
std::string UsedFor(const Json& attempt) {
  return attempt.value("cpu_s", Json()) == 0 ? "-" : DurationAt(attempt, "cpu_s");
}

std::string EnergyOf(const Json& attempt) {
  const Json energy = attempt.value("energy_j", Json());
  return energy.is_number() ? absl::StrCat(std::llround(energy.get<double>()), " J") : "-";
}

// Where the attempts that have ended were played, and what they used, and what was last wrong with each
// block; nothing of attempts on the daemon's host that ended well, which say no more than their lease.
void PrintAttempts(const Json& leases) {
  Json told = Json::array();
  for (const Json& lease : leases) {
    for (Json attempt : lease.value("attempts", Json::array())) {
      if (Cell(attempt, "job") == "-" && Cell(attempt, "how") == "done") continue;
      attempt["block"] = lease.value("lease", Json());
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
                     RowColumn("energy", EnergyOf), "how"});
  }
  for (const Json& lease : leases) {
    if (Cell(lease, "detail") == "-" || Cell(lease, "state") == "cancelled") continue;
    std::cout << Filled(lease, "Block {lease}, what last went wrong: {detail}\n");
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
              << CountedBlocks(queue.value("leases_ahead", int64_t{0})) << '\n';
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
              << ", the daemon steps in by itself\n";
  }
  PrintLeases(status.value("leases", Json::array()));
  PrintAttempts(status.value("leases", Json::array()));
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
    std::cout << Filled(health, ": {running} of {slots:slot} at work, ")
              << CountedBlocks(health.value("pending_leases", int64_t{0})) << " waiting";
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
    std::cout << "  Held back: artefact " << Harmless(artefact.get<std::string>())
              << ": its last evaluations ended by the grader's fault (myograde list, myograde rerun)\n";
  }
  PrintUnreadable(health);
}

void PrintSubmissions(const Json& submissions) {
  if (submissions.empty()) {
    std::cout << "There are no submissions yet." << std::endl;
    return;
  }
  PrintRows(submissions,
            {"id=submission", "team", "track", "profile", "state", ColumnOfPart("episodes", "done"),
             ColumnOfPart("episodes", "of=total"), ColumnOfPart("episodes", "successes=success"),
             ColumnOfPart("episodes", "faults=fault")});
}

absl::StatusOr<int> StatusOfAll(const Client& client, bool json) {
  ASSIGN_OR_RETURN(const Json health, client.Get("/v1/health"));
  ASSIGN_OR_RETURN(const Json list, client.Get("/v1/submissions"));
  const Json submissions = list.value("submissions", Json::array());
  return PrintAnswer(Json{{"daemon", health}, {"submissions", submissions}}, json,
                     [&](const Json&) {
                       PrintHealth(health);
                       PrintSubmissions(submissions);
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

}  // namespace

Action AddStatus(CLI::App& verb) {
  auto options = std::make_shared<StatusOptions>();
  AddSubmissionId(verb, *options, /*required=*/false,
                  "A submission (default: the daemon and its newest 100)");
  verb.add_flag("--wait", options->wait,
                "Wait until the daemon is ready for submissions, for 5 minutes at most; with ID until "
                "that submission has ended");
  AddDaemonOptions(verb, "status", *options);
  return [options] { return Status(*options); };
}

}  // namespace myograde::server
