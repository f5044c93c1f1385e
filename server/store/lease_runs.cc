// Where the attempts of leases ran, and which nodes of a cluster get no leases.
#include <algorithm>
#include <cmath>
#include <utility>

#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr std::string_view kRunEnds[] = {"done", "fault", "returned", "cancelled"};

// More than any attempt can use; in thousandths it is exact in a double.
constexpr double kMostUsed = 1e12;

// Another host measured it, so anything may stand there.
int64_t Thousandths(double value) {
  if (!(value > 0)) return 0;
  return std::llround(std::min(value, kMostUsed) * 1000);
}

StoredRow LeaseRunOf(SQLite::Statement& select, LeaseRunRow& run) {
  StoredRow row(select, "lease_run");
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
  return row;
}

StoredRow DrainedNodeOf(SQLite::Statement& select, DrainedNodeRow& node) {
  StoredRow row(select, "node_event");
  node.id = row.Id(0);
  node.at = row.Time(1);
  row.TextsInto(2, {&node.node, &node.who, &node.why});
  return row;
}

// The newest event of a node and its reason; "" if there is none.
std::pair<std::string, std::string> LatestEvent(SQLite::Database& db, const std::string& node) {
  Statement select(db, "SELECT event, why FROM node_event WHERE node = ? ORDER BY id DESC LIMIT 1",
                   node);
  if (!select.executeStep()) return {};
  return {select.getColumn(0).getString(), select.getColumn(1).getString()};
}

}  // namespace

std::string_view RunEndName(RunEnd end) { return NameIn(kRunEnds, end); }

std::optional<RunEnd> ParseRunEnd(std::string_view name) { return ParseIn<RunEnd>(kRunEnds, name); }

absl::Status Writer::RecordLeaseRun(const LeaseRunRow& run) {
  Run(db_, R"(INSERT INTO lease_run (lease, attempt, node, job, began_at, ended_at, cpu_ms,
      energy_mj, how) VALUES (?, ?, ?, ?, nullif(?, 0), ?, ?, nullif(?, -1), ?)
      ON CONFLICT (lease, attempt) DO NOTHING)",
      run.lease, run.attempt, run.node, run.job, run.began_at,
      run.ended_at == 0 ? now_ms_ : run.ended_at, Thousandths(run.cpu_s),
      run.energy_j.has_value() ? Thousandths(*run.energy_j) : -1, RunEndName(run.how));
  return absl::OkStatus();
}

void Writer::AddNodeEvent(const std::string& node, const char* event, const std::string& why,
                          const std::string& who) {
  Run(db_, "INSERT INTO node_event (at, node, event, who, why) VALUES (?, ?, ?, ?, ?)", now_ms_,
      node, event, who, why);
}

absl::Status Writer::DrainNode(const std::string& node, const std::string& why,
                               const std::string& who) {
  const auto [event, reason] = LatestEvent(db_, node);
  if (event != "drained" || reason != why) AddNodeEvent(node, "drained", why, who);
  return absl::OkStatus();
}

absl::Status Writer::AdmitNode(const std::string& node, const std::string& who) {
  if (LatestEvent(db_, node).first == "drained") AddNodeEvent(node, "admitted", "", who);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<LeaseRunRow>> Reader::LeaseRunsOf(int64_t evaluation) {
  return AllOf<LeaseRunRow>(
      Statement(db_, R"(SELECT r.lease, r.attempt, r.node, r.job, r.began_at, r.ended_at,
          r.cpu_ms, r.energy_mj, r.how FROM lease AS l JOIN lease_run AS r ON r.lease = l.id
          WHERE l.evaluation = ? ORDER BY r.lease, r.attempt)",
                evaluation),
      LeaseRunOf);
}

Listed<DrainedNodeRow> Reader::DrainedNodes() {
  return ListOf<DrainedNodeRow>(
      Statement(db_, R"(SELECT id, at, node, who, why FROM node_event AS n WHERE event = 'drained'
          AND id = (SELECT max(id) FROM node_event WHERE node IS n.node) ORDER BY node)"),
      DrainedNodeOf);
}

}  // namespace myograde::server
