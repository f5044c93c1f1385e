// Acts on boards, and what finished evaluations are ranked by: a view of their episode rows, which can be
// made again.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/sha256.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

// The numbers as raw memory.
std::string BytesOf(const std::vector<double>& numbers) {
  static_assert(std::endian::native == std::endian::little && sizeof(double) == 8);
  return std::string(reinterpret_cast<const char*>(numbers.data()), numbers.size() * 8);
}

std::vector<double> NumbersIn(StoredRow& row, int column) {
  const std::string bytes = row.Blob(column);
  std::vector<double> numbers(bytes.size() / 8);
  if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * 8);
  const bool any_infinite = std::any_of(numbers.begin(), numbers.end(),
                                        [](double number) { return std::isinf(number); });
  if (bytes.size() % 8 != 0 || any_infinite) row.Fail(column, "numbers belong there");
  return numbers;
}

constexpr char kDisqualifiedMark[] = "disqualified";

}  // namespace

absl::StatusOr<bool> Writer::Mark(int64_t submission, const std::string& mark, bool set,
                                  const std::string& who, const std::string& why) {
  Statement select(db_, "SELECT ranked FROM submission WHERE id = ?", submission);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", submission));
  }
  const std::vector<MarkRow>& history = Board().MarkHistory(submission);
  const auto last = std::find_if(history.rbegin(), history.rend(),
                                 [&](const MarkRow& row) { return row.mark == mark; });
  const bool there = last != history.rend();
  const bool is_set = there && last->set;
  const bool same_reason = !there || why.empty() || last->why == why;
  if (is_set == set && (!set || same_reason)) return false;
  nlohmann::json content = {{"submission", submission}, {"mark", mark}, {"set", set}};
  // Boards tell why somebody was disqualified, and nothing of the others.
  if (mark == kDisqualifiedMark) content["reason"] = why;
  Append({.kind = kMarkedAct,
          .who = who,
          .content = std::move(content),
          .beside = {{"why", why}},
          .is_public = select.getColumn(0).getInt() != 0});
  return true;
}

absl::StatusOr<bool> Writer::Choose(int64_t submission, const std::string& who) {
  Statement select(db_, R"(SELECT s.ranked = 1 AND e.state = 'done' FROM submission AS s
      LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' WHERE s.id = ?)",
                   submission);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", submission));
  }
  const auto& submissions = Board().submissions();
  const auto found = submissions.find(submission);
  if (select.getColumn(0).getInt() != 1 || found == submissions.end()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "submission ", submission, " can't be chosen: it is practice, or its evaluation is not "
        "done; choose a ranked one that is"));
  }
  if (Board().NewestChoice(found->second.team, found->second.board) == submission) return false;
  Append({.kind = kChosenAct, .who = who, .content = {{"submission", submission}}});
  return true;
}

absl::StatusOr<bool> Writer::SetBoardConfig(const NewBoardConfig& change, const std::string& who) {
  const BoardName& board = change.board;
  const std::vector<BoardConfigRow>& rows = Board().ConfigsOf(board);
  if (change.rejudge == 0 && !rows.empty() && rows.back().config == change.config) return false;
  if (!change.config_json.empty() && Sha256Hex(change.config_json) != change.config) {
    return absl::InternalError("a board's config has another hash than is said");
  }
  if (!change.config_json.empty()) {
    Run(db_, "INSERT OR IGNORE INTO config VALUES (?, ?, ?, ?, ?)", change.config, board.track,
        board.profile, change.config_json, now_ms_);
  }
  if (!AnyRow(db_, "SELECT 1 FROM config WHERE hash = ?", change.config)) {
    return absl::FailedPreconditionError(
        absl::StrCat("the store has no config ", change.config, " for a board to have"));
  }
  Append({.kind = kConfigAct,
          .who = who,
          .content = {{"phase", OrNull(board.phase)},
                      {"track", board.track},
                      {"profile", board.profile},
                      {"config", change.config},
                      {"rejudge", OrNull(change.rejudge)}}});
  return true;
}

absl::Status Writer::SetStanding(int64_t evaluation, const Standing& standing) {
  const RankedNumbers& ranked = standing.ranked;
  Run(db_, R"(INSERT INTO standing VALUES (?, ?, ?, ?, CAST(? AS BLOB), ?) ON CONFLICT
      (evaluation) DO UPDATE SET successes = excluded.successes, episodes = excluded.episodes, names
      = excluded.names, numbers = excluded.numbers, aggregate_json = excluded.aggregate_json)",
      evaluation, ranked.successes, ranked.episodes, ranked.names, BytesOf(ranked.numbers),
      standing.aggregate_json);
  return absl::OkStatus();
}

absl::Status Writer::DropStandings() {
  db_.exec("DELETE FROM standing");
  return absl::OkStatus();
}

std::map<int64_t, Standing> Reader::Standings(const std::vector<int64_t>& evaluations) {
  Statement select(db_, R"(SELECT evaluation, aggregate_json, successes, episodes, names, numbers
      FROM standing WHERE evaluation IN (SELECT value FROM json_each(?)))",
                   absl::StrCat("[", absl::StrJoin(evaluations, ","), "]"));
  std::map<int64_t, Standing> standings;
  while (select.executeStep()) {
    StoredRow row(select, "standing");
    Standing read;
    read.aggregate_json = row.Text(1);
    read.ranked.successes = row.Number(2, 0, kMany);
    read.ranked.episodes = row.Number(3, 0, kMany);
    read.ranked.names = row.Text(4);
    read.ranked.numbers = NumbersIn(row, 5);
    if (row.ok()) standings.emplace(row.Id(0), std::move(read));
  }
  return standings;
}

std::vector<int64_t> Reader::DoneEvaluations(bool without_standing) {
  return AllNumbers(db_, R"(SELECT e.id
      FROM evaluation AS e LEFT JOIN standing AS v ON v.evaluation = e.id WHERE e.state = 'done'
      AND e.kind != 'rerun' AND (NOT ?1 OR v.evaluation IS NULL) ORDER BY e.id)",
                    without_standing);
}

std::vector<std::string> Reader::GradersOf(const std::vector<int64_t>& evaluations) {
  std::vector<std::string> graders;
  for (const int64_t evaluation : evaluations) {
    graders.push_back(
        FirstText(db_, "SELECT grader_json FROM evaluation WHERE id = ?", evaluation));
  }
  return graders;
}

}  // namespace myograde::server
