#include <algorithm>
#include <cmath>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/blocks.h"
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

constexpr StoredRows<AttemptRow, 9> kRuns = {
    "attempt",
    "SELECT r.block, r.attempt, r.node, r.job, ifnull(r.began_at, 0), r.ended_at, r.cpu_ms, "
    "r.energy_mj, r.how FROM block AS l JOIN attempt AS r ON r.block = l.id "};

constexpr StoredRows<DrainedNodeRow, 4> kNodes = {
    .table = "node_event", .select = "SELECT id, at, node, who, why FROM node_event AS n ", .first = 1};

constexpr StoredRows<BlockRow, 13> kBlocks = {
    .table = "block",
    .select =
        "SELECT id, evaluation, first, last, state, attempt, faults, detail, ifnull(slot, 0), "
        "ifnull(started_at, 0), ifnull(deadline_at, 0), ifnull(finished_at, 0), "
        "ifnull(output_json, '') AS output FROM block ",
    .wrong = [](const BlockRow& block) {
      if (block.last < block.first) return "its last episode comes before its first";
      return IsFinal(block.state) == (block.finished_at > 0)
                 ? ""
                 : "its \"state\" and its \"finished_at\" contradict each other";
    }};

}  // namespace

absl::Status Blocks::Refused(const char* what, const BlockRow& block, std::string_view step) {
  return absl::FailedPreconditionError(absl::StrCat(
      "block ", block.id, " can't be ", what, ": it is ", std::string(EnumName(block.state)),
      ", attempt ", block.attempt, std::string(step)));
}

absl::StatusOr<std::vector<BlockRow>> Blocks::Of(int64_t evaluation) const {
  return kBlocks.All(db_, "WHERE evaluation = ? ORDER BY first", evaluation);
}

absl::StatusOr<BlockRow> Blocks::Find(int64_t block) {
  return kBlocks.First(db_, NoSuch("block", block), "WHERE id = ?", block);
}

absl::Status Blocks::Start(int64_t block, int64_t attempt, int64_t slot, int64_t deadline_ms,
                           const std::string& who) {
  ASSIGN_OR_RETURN(BlockRow row, Find(block));
  if (row.state == BlockState::kRunning && row.attempt == attempt) return absl::OkStatus();
  if (row.state != BlockState::kPending || attempt != row.attempt + 1) {
    return Refused("started", row, absl::StrCat(", not before attempt ", attempt));
  }
  Run(db_, R"(UPDATE block SET state = 'running',
      attempt = ?, slot = ?, owner = ?, started_at = ?, deadline_at = ? WHERE id = ?)",
      attempt, slot, who, now_ms_, deadline_ms, block);
  RETURN_IF_ERROR(Audit("block", block, "pending", "running", who,
                        absl::StrCat("attempt ", attempt, " on slot ", slot)));
  const int began = Run(db_, R"(UPDATE evaluation
      SET state = 'running', started_at = ? WHERE id = ? AND state = 'queued')",
                        now_ms_, row.evaluation);
  if (began == 0) return absl::OkStatus();  // already running
  return Audit("evaluation", row.evaluation, "queued", "running", who, "its first block started");
}

absl::Status Blocks::Finish(int64_t block, int64_t attempt, const std::string& output_json,
                            const std::string& who) {
  ASSIGN_OR_RETURN(BlockRow row, Find(block));
  if (row.state == BlockState::kDone && row.attempt == attempt) return absl::OkStatus();
  if (row.state != BlockState::kRunning || row.attempt != attempt) {
    return Refused("finished", row, absl::StrCat(", not ", attempt));
  }
  const int64_t episodes = FirstValue<int64_t>(db_, R"(SELECT count(*)
      FROM episode WHERE block = ? AND evaluation = ? AND idx BETWEEN ? AND ?)",
                                               block, row.evaluation, row.first, row.last);
  if (episodes != row.last - row.first + 1) {
    return Refused("finished", row, ", and episodes are missing");
  }
  Run(db_, R"(UPDATE block SET state = 'done', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, finished_at = ?, output_json = ? WHERE id = ?)",
      now_ms_, output_json, block);
  return Audit("block", block, "running", "done", who, absl::StrCat("attempt ", attempt));
}

absl::Status Blocks::Return(int64_t block, int64_t attempt, bool fault, const std::string& who,
                            const std::string& why) {
  ASSIGN_OR_RETURN(BlockRow row, Find(block));
  if (row.state == BlockState::kPending && row.attempt == attempt) return absl::OkStatus();
  if (row.state != BlockState::kRunning || row.attempt != attempt) {
    return Refused("returned", row, absl::StrCat(", not ", attempt));
  }
  Run(db_, R"(UPDATE block SET state = 'pending', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, faults = faults + ?, detail = ? WHERE id = ?)",
      fault, why, block);
  return Audit("block", block, "running", "pending", who, why);
}

absl::Status Blocks::End(int64_t block, BlockState state, bool fault, const std::string& who,
                         const std::string& why) {
  ASSIGN_OR_RETURN(BlockRow row, Find(block));
  if (row.state == state) return absl::OkStatus();
  if (IsFinal(row.state) || (state != BlockState::kFailed && state != BlockState::kCancelled)) {
    return Refused("ended", row, "");
  }
  Run(db_, R"(UPDATE block SET state = ?, slot = NULL, owner = NULL, started_at = NULL,
      deadline_at = NULL, finished_at = ?, faults = faults + ?, detail = ? WHERE id = ?)",
      EnumName(state), now_ms_, fault, why, block);
  return Audit("block", block, EnumName(row.state), EnumName(state), who, why);
}

absl::Status Blocks::RecordAttempt(const AttemptRow& run) {
  Run(db_, R"(INSERT INTO attempt (block, attempt, node, job, began_at, ended_at, cpu_ms,
      energy_mj, how) VALUES (?, ?, ?, ?, nullif(?, 0), ?, ?, nullif(?, -1), ?)
      ON CONFLICT (block, attempt) DO NOTHING)",
      run.block, run.attempt, run.node, run.job, run.began_at,
      run.ended_at == 0 ? now_ms_ : run.ended_at, Thousandths(run.cpu_s),
      run.energy_j.has_value() ? Thousandths(*run.energy_j) : -1, EnumName(run.how));
  return absl::OkStatus();
}

absl::Status Blocks::SetNode(const std::string& node, bool drained, const std::string& why,
                             const std::string& who) {
  const auto [event, reason] = FirstRow<std::string, std::string>(
      db_, "SELECT event, why FROM node_event WHERE node = ? ORDER BY id DESC LIMIT 1", node);
  if ((event == "drained") == drained && (!drained || reason == why)) return absl::OkStatus();
  Run(db_, "INSERT INTO node_event (at, node, event, who, why) VALUES (?, ?, ?, ?, ?)", now_ms_,
      node, drained ? "drained" : "admitted", who, why);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<AttemptRow>> Blocks::ListAttempts(int64_t evaluation) const {
  return kRuns.All(db_, "WHERE l.evaluation = ? ORDER BY r.block, r.attempt", evaluation);
}

Listed<DrainedNodeRow> Blocks::DrainedNodes() const {
  return kNodes.List(db_, R"(WHERE event = 'drained'
      AND id = (SELECT max(id) FROM node_event WHERE node IS n.node) ORDER BY node)");
}

}  // namespace myograde::server
