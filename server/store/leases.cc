// Where the attempts of leases ran, and which nodes of a cluster get no leases.
#include <algorithm>
#include <cmath>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/store/leases.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

// More than any attempt can use; in thousandths it is exact in a double.
constexpr double kMostUsed = 1e12;

// Another host measured it, so anything may stand there.
int64_t Thousandths(double value) {
  if (!(value > 0)) return 0;
  return std::llround(std::min(value, kMostUsed) * 1000);
}

constexpr StoredRows<LeaseRunRow> kRuns = {
    "lease_run",
    "SELECT r.lease, r.attempt, r.node, r.job, r.began_at, r.ended_at, r.cpu_ms, r.energy_mj, "
    "r.how FROM lease AS l JOIN lease_run AS r ON r.lease = l.id ",
    [](StoredRow& row, LeaseRunRow& run) {
      run.lease = row.Id(0);
      run.attempt = row.Id(1);
      run.node = row.Text(2);
      run.job = row.Text(3);
      run.began_at = row.TimeOr0(4);
      run.ended_at = row.Time(5);
      run.cpu_s = static_cast<double>(row.Number(6, 0, INT64_MAX)) / 1000;
      const int64_t energy = row.NumberOr(7, 0, INT64_MAX, -1);
      if (energy >= 0) run.energy_j = static_cast<double>(energy) / 1000;
      run.how = row.Named(8, ParseRunEnd);
    }};

constexpr StoredRows<DrainedNodeRow> kNodes = {
    "node_event", "SELECT id, at, node, who, why FROM node_event AS n ",
    [](StoredRow& row, DrainedNodeRow& node) {
      node.id = row.Id(0);
      node.at = row.Time(1);
      row.TextsInto(2, {&node.node, &node.who, &node.why});
    }};

// The newest event of a node and its reason; "" if there is none.
std::pair<std::string, std::string> LatestEvent(SQLite::Database& db, const std::string& node) {
  Statement select(db, "SELECT event, why FROM node_event WHERE node = ? ORDER BY id DESC LIMIT 1",
                   node);
  if (!select.executeStep()) return {};
  return {select.getColumn(0).getString(), select.getColumn(1).getString()};
}

constexpr StoredRows<LeaseRow> kLeases = {
    "lease",
    "SELECT id, first, last, state, attempt, faults, detail, slot, started_at, deadline_at, "
    "finished_at, output_json, evaluation FROM lease ",
    [](StoredRow& row, LeaseRow& lease) {
      lease.id = row.Id(0);
      lease.evaluation = row.Id(12);
      lease.first = row.Number(1, 0, kMaxEpisodes - 1);
      lease.last = row.Number(2, lease.first, kMaxEpisodes - 1);
      lease.state = row.Named(3, ParseLeaseState);
      lease.attempt = row.Number(4, 0, kMany);
      lease.faults = row.Number(5, 0, lease.attempt);
      lease.detail = row.Text(6);
      lease.slot = row.NumberOr(7, 0, kMany, -1);
      lease.started_at = row.TimeOr0(8);
      lease.deadline_at = row.TimeOr0(9);
      lease.finished_at = row.TimeOr0(10);
      if (!row.IsNull(11)) lease.output_json = row.Object(11);
      if (IsFinal(lease.state) == row.IsNull(10)) row.Fail(3, "its time of ending says otherwise");
    }};

}  // namespace

absl::Status Leases::Refused(const char* what, const LeaseRow& lease, std::string_view step) {
  return absl::FailedPreconditionError(absl::StrCat(
      "lease ", lease.id, " can't be ", what, ": it is ", std::string(LeaseStateName(lease.state)),
      ", attempt ", lease.attempt, std::string(step)));
}

absl::StatusOr<std::vector<LeaseRow>> Leases::Of(int64_t evaluation) const {
  return kLeases.All(db_, "WHERE evaluation = ? ORDER BY first", evaluation);
}

absl::StatusOr<LeaseRow> Leases::Find(int64_t lease) {
  return kLeases.First(db_, NoSuch("lease", lease), "WHERE id = ?", lease);
}

absl::Status Leases::RunEvaluation(int64_t evaluation, const std::string& who) {
  Statement update(db_, R"(UPDATE evaluation
      SET state = 'running', started_at = ? WHERE id = ? AND state = 'queued')",
                   now_ms_, evaluation);
  if (update.exec() == 0) return absl::OkStatus();  // already running
  return Audit("evaluation", evaluation, "queued", "running", who, "its first lease started");
}

absl::Status Leases::Start(int64_t lease, int64_t attempt, int64_t slot, int64_t deadline_ms,
                           const std::string& who) {
  ASSIGN_OR_RETURN(LeaseRow row, Find(lease));
  if (row.state == LeaseState::kRunning && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kPending || attempt != row.attempt + 1) {
    return Refused("started", row, absl::StrCat(", not before attempt ", attempt));
  }
  Run(db_, R"(UPDATE lease SET state = 'running',
      attempt = ?, slot = ?, owner = ?, started_at = ?, deadline_at = ? WHERE id = ?)",
      attempt, slot, who, now_ms_, deadline_ms, lease);
  RETURN_IF_ERROR(Audit("lease", lease, "pending", "running", who,
                        absl::StrCat("attempt ", attempt, " on slot ", slot)));
  return RunEvaluation(row.evaluation, who);
}

absl::Status Leases::Finish(int64_t lease, int64_t attempt, const std::string& output_json,
                            const std::string& who) {
  ASSIGN_OR_RETURN(LeaseRow row, Find(lease));
  if (row.state == LeaseState::kDone && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refused("finished", row, absl::StrCat(", not ", attempt));
  }
  const int64_t episodes = FirstValue<int64_t>(db_, R"(SELECT count(*)
      FROM episode WHERE lease = ? AND evaluation = ? AND idx BETWEEN ? AND ?)",
                                               lease, row.evaluation, row.first, row.last);
  if (episodes != row.last - row.first + 1) {
    return Refused("finished", row, ", and episodes are missing");
  }
  Run(db_, R"(UPDATE lease SET state = 'done', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, finished_at = ?, output_json = ? WHERE id = ?)",
      now_ms_, output_json, lease);
  return Audit("lease", lease, "running", "done", who, absl::StrCat("attempt ", attempt));
}

absl::Status Leases::Return(int64_t lease, int64_t attempt, bool fault, const std::string& who,
                            const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Find(lease));
  if (row.state == LeaseState::kPending && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refused("returned", row, absl::StrCat(", not ", attempt));
  }
  Run(db_, R"(UPDATE lease SET state = 'pending', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, faults = faults + ?, detail = ? WHERE id = ?)",
      fault, why, lease);
  return Audit("lease", lease, "running", "pending", who, why);
}

absl::Status Leases::End(int64_t lease, LeaseState state, bool fault, const std::string& who,
                         const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Find(lease));
  if (row.state == state) return absl::OkStatus();
  if (IsFinal(row.state) || (state != LeaseState::kFailed && state != LeaseState::kCancelled)) {
    return Refused("ended", row, "");
  }
  Run(db_, R"(UPDATE lease SET state = ?, slot = NULL, owner = NULL, started_at = NULL,
      deadline_at = NULL, finished_at = ?, faults = faults + ?, detail = ? WHERE id = ?)",
      LeaseStateName(state), now_ms_, fault, why, lease);
  return Audit("lease", lease, LeaseStateName(row.state), LeaseStateName(state), who, why);
}

absl::Status Leases::RecordRun(const LeaseRunRow& run) {
  Run(db_, R"(INSERT INTO lease_run (lease, attempt, node, job, began_at, ended_at, cpu_ms,
      energy_mj, how) VALUES (?, ?, ?, ?, nullif(?, 0), ?, ?, nullif(?, -1), ?)
      ON CONFLICT (lease, attempt) DO NOTHING)",
      run.lease, run.attempt, run.node, run.job, run.began_at,
      run.ended_at == 0 ? now_ms_ : run.ended_at, Thousandths(run.cpu_s),
      run.energy_j.has_value() ? Thousandths(*run.energy_j) : -1, RunEndName(run.how));
  return absl::OkStatus();
}

void Leases::AddNodeEvent(const std::string& node, const char* event, const std::string& why,
                          const std::string& who) {
  Run(db_, "INSERT INTO node_event (at, node, event, who, why) VALUES (?, ?, ?, ?, ?)", now_ms_,
      node, event, who, why);
}

absl::Status Leases::DrainNode(const std::string& node, const std::string& why,
                               const std::string& who) {
  const auto [event, reason] = LatestEvent(db_, node);
  if (event != "drained" || reason != why) AddNodeEvent(node, "drained", why, who);
  return absl::OkStatus();
}

absl::Status Leases::AdmitNode(const std::string& node, const std::string& who) {
  if (LatestEvent(db_, node).first == "drained") AddNodeEvent(node, "admitted", "", who);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<LeaseRunRow>> Leases::ListRuns(int64_t evaluation) const {
  return kRuns.All(db_, "WHERE l.evaluation = ? ORDER BY r.lease, r.attempt", evaluation);
}

Listed<DrainedNodeRow> Leases::DrainedNodes() const {
  return kNodes.List(db_, R"(WHERE event = 'drained'
      AND id = (SELECT max(id) FROM node_event WHERE node IS n.node) ORDER BY node)");
}

}  // namespace myograde::server
