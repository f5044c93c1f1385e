// Whose something is, and rows about denied requests and acts.
#include <gmock/gmock.h>

#include <absl/strings/str_cat.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

class AccessEventsTest : public StoreTest {
 protected:
  void Add(const std::string& kind, const std::string& who, int64_t count = 1) {
    AccessEventRow row;
    row.kind = kind;
    row.who = who;
    row.role = "participant";
    row.action = "read log";
    row.detail = "another team's";
    row.count = count;
    const absl::Status status =
        store_->Write([&](Transaction& writer) { return writer.callers.AddEvent(row); });
    ASSERT_TRUE(status.ok()) << status;
  }

  std::vector<std::string> Who(const std::string& kind, int64_t before = INT64_MAX,
                               int64_t limit = 100) {
    std::vector<std::string> who;
    ReaderPool readers(path_);
    const absl::Status status = readers.Read([&](const Transaction& reader) {
      for (const AccessEventRow& row : reader.callers.Events(kind, before, limit).rows) {
        who.push_back(absl::StrCat(row.who, " x", row.count));
      }
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
    return who;
  }
};

TEST_F(AccessEventsTest, TheNewestComeFirstInPagesOfAKind) {
  Add("denied", "a", 3);
  Add("act", "b");
  Add("denied", "c");
  EXPECT_THAT(Who(""), testing::ElementsAre("c x1", "b x1", "a x3"));
  EXPECT_THAT(Who("denied"), testing::ElementsAre("c x1", "a x3"));
  EXPECT_THAT(Who("act"), testing::ElementsAre("b x1"));
  EXPECT_THAT(Who("", INT64_MAX, 1), testing::ElementsAre("c x1"));
  EXPECT_THAT(Who("", 3, 1), testing::ElementsAre("b x1"));
}

TEST_F(AccessEventsTest, EqualDenialsOfADayShareARowAndADayHasFew) {
  AccessEventRow denied;
  denied.kind = "denied";
  denied.action = "read log";
  AccessEventRow others = denied;
  others.who = "others";
  const auto deny = [&](const std::string& who) {
    denied.who = who;
    ASSERT_TRUE(
        store_->Write([&](Transaction& writer) { return writer.callers.AddDenial(denied, others); })
            .ok());
  };
  for (int i = 0; i < 3; ++i) {
    deny("a");
    clock_.Advance(absl::Minutes(5));
  }
  EXPECT_THAT(Who(""), testing::ElementsAre("a x3"));
  clock_.Advance(absl::Hours(24));
  deny("a");
  EXPECT_THAT(Who(""), testing::ElementsAre("a x1", "a x3"));
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    absl::Status status;
    for (int i = 0; i < 1500; ++i) {
      denied.who = absl::StrCat("address ", i);
      status.Update(writer.callers.AddDenial(denied, others));
    }
    return status;
  }).ok());
  EXPECT_EQ(Who("", INT64_MAX, 5000).size(), 1u + kMostDenialsOfADay + 1u);
  EXPECT_EQ(Who("").front(), "others x501");
  deny("a");
  EXPECT_EQ(Who("").front(), "others x501") << "a kind with a row of its own counts there";
  // A day that is full, as seen from the one before it once a wrong clock is set back.
  clock_.Advance(-absl::Hours(24));
  deny("z");
  EXPECT_THAT(Who("", INT64_MAX, 5000), testing::Contains("z x1"));
  clock_.Advance(absl::Hours(24));
  const int64_t newest =
      SQLite::Database(path_).execAndGet("SELECT max(at) FROM access_event").getInt64();
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    writer.callers.RemoveDenials(newest - absl::ToInt64Milliseconds(absl::Hours(12)));
    return absl::OkStatus();
  }).ok());
  EXPECT_EQ(Who("", INT64_MAX, 5000).size(), size_t{kMostDenialsOfADay} + 1u);
}

TEST_F(AccessEventsTest, AKindThatThereIsNotIsRefused) {
  AccessEventRow row;
  row.kind = "other";
  row.who = "a";
  row.action = "read log";
  EXPECT_FALSE(
      store_->Write([&](Transaction& writer) { return writer.callers.AddEvent(row); }).ok());
  EXPECT_TRUE(Who("").empty());
}

TEST_F(AccessEventsTest, TheyAreNeverChangedOrDeleted) {
  Add("act", "a");
  SQLite::Database db(path_, SQLite::OPEN_READWRITE);
  EXPECT_THROW(db.exec("UPDATE access_event SET who = 'b'"), SQLite::Exception);
  EXPECT_THROW(db.exec("DELETE FROM access_event"), SQLite::Exception);
}

TEST_F(AccessEventsTest, AnUnreadableOneIsReportedAndTheOthersAreShown) {
  Add("act", "a");
  Add("act", "b");
  SQLite::Database db(path_, SQLite::OPEN_READWRITE);
  db.exec("PRAGMA ignore_check_constraints = ON; UPDATE access_event SET count = 0 WHERE id = 1");
  ReaderPool readers(path_);
  const absl::Status status = readers.Read([&](const Transaction& reader) {
    const Listed<AccessEventRow> listed = reader.callers.Events("", INT64_MAX, 100);
    EXPECT_EQ(listed.rows.size(), 1u);
    EXPECT_EQ(listed.found() - std::ssize(listed.rows), 1);
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
}

TEST_F(AccessEventsTest, SubmissionsEvaluationsAndLogsAreATeams) {
  const absl::StatusOr<Accepted> accepted = TrySubmit("alpha", 'a', /*ranked=*/true);
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  const std::string log(64, 'e');
  const absl::Status played = store_->Write([&](Transaction& writer) -> absl::Status {
    const int64_t block = accepted->blocks.front();
    absl::Status status = writer.blocks.Start(block, 1, 0, 0, "test");
    EpisodeRow row;
    row.evaluation = accepted->evaluation;
    row.block = block;
    row.attempt = 1;
    row.seed = 1;
    row.outcome = Outcome::kSuccess;
    row.facts_json = absl::StrCat(R"({"log":{"sha256":")", log, R"("}})");
    row.metrics_json = "{}";
    status.Update(writer.episodes.Record(row).status());
    return status;
  });
  ASSERT_TRUE(played.ok()) << played;
  ReaderPool readers(path_);
  const absl::Status status = readers.Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.submissions.TeamOf(accepted->submission).value_or(""), "alpha");
    EXPECT_EQ(reader.evaluations.TeamOf(accepted->evaluation).value_or(""), "alpha");
    EXPECT_THAT(reader.episodes.TeamsOfLog(log),
                testing::ElementsAre(testing::Pair("alpha", testing::ElementsAre(""))));
    EXPECT_TRUE(reader.episodes.TeamsOfLog(std::string(64, 'f')).empty());
    // The words are those of the readers of whole rows: nobody can tell the two apart.
    EXPECT_EQ(reader.submissions.TeamOf(99).status(), reader.submissions.Find(99).status());
    EXPECT_EQ(reader.evaluations.TeamOf(99).status(), reader.evaluations.Find(99).status());
    SubmissionFilter filter;
    filter.teams = std::set<std::string>{"beta"};
    EXPECT_TRUE(reader.submissions.List(filter).rows.empty());
    filter.teams->insert("alpha");
    EXPECT_EQ(reader.submissions.List(filter).rows.size(), 1u);
    filter.teams->clear();
    EXPECT_TRUE(reader.submissions.List(filter).rows.empty());
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
}

}  // namespace
}  // namespace myograde::server
