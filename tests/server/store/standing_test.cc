// The view that boards are built from, and the counter that tells whether a cached board is stale.
#include <gtest/gtest.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

// The time has no short binary form: every bit must survive.
constexpr char kAggregate[] =
    R"({"distance_m":null,"effort":0.1,"effort_over_steps":0.7,"episodes":4,"pain":null,"pain_over_steps":0.1111111111111111,"successes":3,"time_s":0.3333333333333333})";

class StandingTest : public StoreTest {
 protected:
  void Play(const Accepted& accepted) {
    for (size_t i = 0; i < accepted.blocks.size(); ++i) {
      const int64_t block = accepted.blocks[i];
      ASSERT_TRUE(Start(block, 1).ok());
      for (const int64_t index : {2 * i, 2 * i + 1}) ASSERT_TRUE(Record(accepted, index, 1).ok());
      ASSERT_TRUE(
          Write([&](Transaction& w) { return w.blocks.Finish(block, 1, "{}", "daemon"); }).ok());
    }
  }

  absl::Status Write(const std::function<absl::Status(Transaction&)>& change) {
    return store_->Write(change);
  }

  void End(const Accepted& accepted) {
    const absl::Status status = Write([&](Transaction& writer) {
      absl::Status written = writer.evaluations.End(accepted.evaluation, EvaluationState::kDone, "",
                                                  std::string(64, 'e'), "daemon");
      written.Update(writer.episodes.SetStanding(accepted.evaluation,
                                                 nlohmann::json::parse(kAggregate)));
      return written;
    });
    ASSERT_TRUE(status.ok()) << status;
  }

  int64_t Changes() {
    int64_t changes = -1;
    Read([&](const Transaction& reader) { changes = reader.Board().board_changes(); });
    return changes;
  }
};

TEST_F(StandingTest, HoldsTheNumbersWithEveryBit) {
  const Accepted accepted = Submit();
  Play(accepted);
  End(accepted);
  Read([&](const Transaction& reader) {
    std::vector<StandingRow> rows = {{.evaluation = 99}, {.evaluation = accepted.evaluation}};
    reader.episodes.ReadStandings(rows);
    EXPECT_TRUE(rows[0].aggregate.is_null());
    EXPECT_EQ(rows[0].artefact_name, "");
    EXPECT_EQ(rows[1].artefact_name,
              reader.submissions.Find(accepted.submission)->artefact_name);
    const nlohmann::json& ranked = rows[1].aggregate;
    EXPECT_EQ(ranked.dump(), kAggregate);
    EXPECT_EQ(ranked["successes"], 3);
    EXPECT_EQ(ranked["episodes"], 4);
    EXPECT_EQ(ranked["time_s"].get<double>(), 0.3333333333333333);
    EXPECT_EQ(ranked["effort"].get<double>(), 0.1);
    EXPECT_TRUE(ranked["pain"].is_null());
    EXPECT_EQ(ranked["effort_over_steps"].get<double>(), 0.7);
  });
}

// The view is rebuilt from the episodes' rows, so an unreadable entry counts as missing.
TEST_F(StandingTest, NumbersThatAreNoneAreNotThere) {
  const Accepted accepted = Submit();
  Play(accepted);
  End(accepted);
  // Cut off; no object; infinity.
  for (const char* aggregate : {"{", "7", "{\"time_s\":1e999}"}) {
    SQLite::Database(path_, SQLite::OPEN_READWRITE)
        .exec(absl::StrCat("UPDATE standing SET aggregate_json = '", aggregate, "'"));
    Read([&](const Transaction& reader) {
      std::vector<StandingRow> rows = {{.evaluation = accepted.evaluation}};
      reader.episodes.ReadStandings(rows);
      EXPECT_TRUE(rows[0].aggregate.is_null()) << aggregate;
      EXPECT_NE(rows[0].artefact_name, "");
    });
  }
}

TEST_F(StandingTest, PracticeLeavesBoardsAsTheyAreAndOfficialEvaluationsDoNot) {
  const absl::StatusOr<Accepted> practice = TrySubmit("alpha", 'b', /*ranked=*/false);
  ASSERT_TRUE(practice.ok()) << practice.status();
  const Accepted official = Submit();
  Play(*practice);
  Play(official);
  const int64_t before = Changes();
  End(*practice);
  EXPECT_EQ(Changes(), before);
  End(official);
  EXPECT_GT(Changes(), before);
}

// The reasons of failures belong to the tracks, so the table's schema does not list them.
TEST_F(StandingTest, EpisodesTakeAnyShortReasonAndStandAsTheyAre) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
  ASSERT_TRUE(Record(accepted, 0, 1).ok());
  SQLite::Database db(path_, SQLite::OPEN_READWRITE);
  db.exec("PRAGMA foreign_keys = ON");
  const std::string insert = "INSERT INTO episode VALUES (1, 1, 1, 1, 8, 'failure', '";
  EXPECT_THROW(db.exec(insert + "', '{}', '{}', 5, '')"), SQLite::Exception);
  EXPECT_THROW(db.exec(insert + std::string(41, 'a') + "', '{}', '{}', 5, '')"), SQLite::Exception);
  db.exec(insert + "given-up', '{}', '{}', 5, '')");
  db.exec("INSERT INTO replay VALUES (1, 1, 0, 2, '[\"digest\"]', '{}', 6)");
  for (const char* forbidden :
       {"UPDATE episode SET seed = 9", "DELETE FROM episode", "DELETE FROM replay",
        "INSERT INTO episode VALUES (1, 90, 1, 1, 8, 'failure', 'time', '{}', '{}', 5, '')",
        "INSERT INTO replay VALUES (2, 1, 9, 2, '[]', '{}', 6)"}) {
    EXPECT_THROW(db.exec(forbidden), SQLite::Exception) << forbidden;
  }
}

TEST_F(StandingTest, AnEpisodesRowFitsIntoAPage) {
  SQLite::Database db(path_);
  EXPECT_EQ(db.execAndGet("PRAGMA page_size").getInt(), 8192);
}

}  // namespace
}  // namespace myograde::server
