// A store with teams and people.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {

inline constexpr char kAda[] = "uid 1001";
inline constexpr char kBob[] = "uid 1002";

class PeopleTest : public StoreTest {
 protected:
  absl::Status Write(const std::function<absl::Status(Transaction&)>& change) {
    return store_->Write(change);
  }
  absl::Status Create(const std::string& team) {
    return Write([&](Transaction& w) { return w.teams.Create(team, "uid 0", ""); });
  }
  absl::Status Found(const std::string& team, const std::string& person, int64_t most = 1) {
    return Write([&](Transaction& w) { return w.teams.Found(team, person, most); });
  }
  absl::Status Rename(const std::string& team, const std::string& name) {
    return Write(
        [&](Transaction& w) { return w.teams.Rename(team, name, "uid 0", "asked for").status(); });
  }
  absl::Status Merge(const std::string& team, const std::string& into) {
    return Write([&](Transaction& w) { return w.teams.Merge(team, into, "uid 0", "one group"); });
  }
  absl::Status Ban(const std::string& team, bool banned = true) {
    return Write(
        [&](Transaction& w) { return w.teams.Ban(team, banned, "uid 0", "cheats").status(); });
  }
  absl::Status SetMember(const std::string& team, const std::string& person, bool belongs) {
    return Write(
        [&](Transaction& w) { return w.teams.SetMember(team, person, belongs, "uid 0").status(); });
  }
  absl::Status Try(const std::string& team, char artefact = 'a') {
    return TrySubmit(team, artefact, /*ranked=*/true).status();
  }
  std::set<std::string> TeamsOf(const std::string& person) {
    std::set<std::string> teams;
    Read([&](const Transaction& reader) { teams = reader.teams.OfPerson(person); });
    return teams;
  }
  std::vector<std::string> ListMembers(const std::string& team) {
    std::vector<std::string> members;
    Read([&](const Transaction& reader) {
      for (const MemberRow& member : reader.teams.Members(team).rows)
        members.push_back(member.person);
    });
    return members;
  }
  std::string TeamOf(const std::string& name) {
    std::string team;
    Read([&](const Transaction& reader) { team = reader.teams.NameOf(name); });
    return team;
  }
  // Plays a submission to its end, so that it can stand on a board.
  void Play(const Accepted& accepted) {
    for (const size_t block : {0, 1}) {
      const auto first = static_cast<int64_t>(2 * block);
      ASSERT_TRUE(Start(accepted.blocks[block], 1).ok());
      ASSERT_TRUE(Record(accepted, first, 1).ok() && Record(accepted, first + 1, 1).ok());
      ASSERT_TRUE(Write([&](Transaction& w) {
        return w.blocks.Finish(accepted.blocks[block], 1, "{}", "daemon");
      }).ok());
    }
    ASSERT_TRUE(Write([&](Transaction& w) {
      return w.evaluations.End(accepted.evaluation, EvaluationState::kDone, "", "x", "daemon");
    }).ok());
  }
  // The teams of the rows that may stand on the board, by submission.
  std::vector<std::string> Board() {
    std::vector<std::string> teams;
    Read([&](const Transaction& reader) {
      const BoardState& board = reader.Board();
      for (const auto& [submission, result] : board.InForce(std::string(64, 'c'))) {
        const TeamState* team = board.TeamOf(submission);
        if (!result->failed && !team->banned) teams.push_back(team->name);
      }
    });
    return teams;
  }
  int64_t BoardChanges() {
    int64_t changes = 0;
    Read([&](const Transaction& reader) { changes = reader.Board().board_changes(); });
    return changes;
  }
  QuotaUse Quota(const std::string& team) {
    QuotaUse use;
    Read([&](const Transaction& reader) {
      use = reader.quotas.CountQuotaUse(team, "manipulation", absl::ToUnixMillis(clock_.Now()));
    });
    return use;
  }
  // All rows of tables that no act on a team may change.
  std::string History() {
    SQLite::Database db(path_);
    std::string text;
    for (const char* table : {"submission", "ledger"}) {
      SQLite::Statement select(db, absl::StrCat("SELECT * FROM ", table, " ORDER BY 1"));
      while (select.executeStep()) {
        for (int i = 0; i < select.getColumnCount(); ++i) {
          absl::StrAppend(&text, select.getColumn(i).getString(), "|");
        }
      }
    }
    return text;
  }
};

inline std::string Sentence(const absl::Status& status) { return std::string(status.message()); }

}  // namespace myograde::server
