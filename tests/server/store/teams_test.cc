// Team names: one team for all forms of a name, rejection of look-alikes, and names in old stores
// that stay valid.
#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/error_code.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kCyrillic[] = "\xd0\xb0lpha";  // its first letter
constexpr char kNoBreak[] = "Team\xc2\xa0" "Blue";
constexpr char kFiller[] = "alpha\xe3\x85\xa4";

class TeamsTest : public StoreTest {
 protected:
  absl::Status Try(const std::string& team, char artefact = 'a') {
    return TrySubmit(team, artefact, /*ranked=*/false).status();
  }
  std::string TeamOfLast() {
    std::string team;
    Read([&](const Transaction& reader) { team = reader.submissions.List({}).rows.front().team; });
    return team;
  }
  int64_t Count(const std::string& table) {
    SQLite::Database db(path_);
    return db.execAndGet("SELECT count(*) FROM " + table).getInt64();
  }
  // As a program older than the rule would have written it.
  void AddOldTeam(const std::string& name) {
    SQLite::Database db(path_, SQLite::OPEN_READWRITE);
    SQLite::Statement insert(db, "INSERT INTO team (name, created_at) VALUES (?, 1)");
    insert.bind(1, name);
    insert.exec();
    SQLite::Statement named(db, "INSERT INTO team_name VALUES (?, last_insert_rowid())");
    named.bind(1, name);
    named.exec();
    db.exec("DELETE FROM team_skeleton");
    db.exec("DELETE FROM meta WHERE key = 'team_skeletons'");
  }
};

TEST_F(TeamsTest, TheFormsOfANameAreOneTeam) {
  ASSERT_TRUE(Try("Team Blue").ok());
  for (const char* name : {"Team Blue", kNoBreak, "Team  Blue", "\xef\xbc\xb4" "eam Blue"}) {
    EXPECT_TRUE(Try(name).ok()) << name;
    EXPECT_EQ(TeamOfLast(), "Team Blue");
    Read([&](const Transaction& reader) {
      EXPECT_EQ(reader.teams.NameOf(name), "Team Blue");
      EXPECT_TRUE(reader.teams.Check(name).ok());
    });
  }
  EXPECT_EQ(Count("team"), 1);
}

TEST_F(TeamsTest, ALookAlikeIsRefusedWhereverATeamIsMade) {
  ASSERT_TRUE(Try("alpha").ok());
  for (const std::string name : {kCyrillic, "ALPHA", "aIpha", "a1pha"}) {
    std::vector<absl::Status> refusals = {Try(name)};
    refusals.push_back(store_->Write([&](Transaction& writer) {
      return writer.quotas.ChargeFailure(name, "manipulation", "uid 0", "upload refused");
    }));
    refusals.push_back(store_->Write([&](Transaction& writer) {
      return writer.quotas.Grant({name, "manipulation", Budget::kRanked, 1, "why"}, "uid 0");
    }));
    Read([&](const Transaction& reader) { refusals.push_back(reader.teams.Check(name)); });
    for (const absl::Status& refused : refusals) {
      EXPECT_TRUE(absl::IsFailedPrecondition(refused)) << name << ": " << refused;
      EXPECT_EQ(ErrorCodeOf(refused), "look_alike");
      EXPECT_EQ(ResembledTeam(refused), "alpha");
      EXPECT_THAT(std::string(refused.message()), Not(HasSubstr("alpha"))) << "that is told to all";
    }
  }
  EXPECT_TRUE(absl::IsInvalidArgument(Try(kFiller)));
  EXPECT_THAT(std::string(Try(kFiller).message()), HasSubstr("has U+3164, which is not seen"));
  EXPECT_EQ(Count("team"), 1);
  EXPECT_EQ(Count("submission"), 1);
  EXPECT_TRUE(Try("beta").ok());
}

// Concurrent requests share a transaction, and each sees those before it.
TEST_F(TeamsTest, OfTwoFirstSubmissionsAtOnceOneIsRefused) {
  std::vector<absl::Status> statuses;
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    for (const char* name : {"alpha", kCyrillic, "Alpha", "beta"}) {
      statuses.push_back(writer.Part([&](Transaction& part) {
        return part.quotas.Grant({name, "manipulation", Budget::kRanked, 1, "why"}, "uid 0");
      }));
    }
    return absl::OkStatus();
  }).ok());
  EXPECT_TRUE(statuses[0].ok() && statuses[3].ok());
  EXPECT_EQ(ErrorCodeOf(statuses[1]), "look_alike");
  EXPECT_EQ(ErrorCodeOf(statuses[2]), "look_alike");
  EXPECT_EQ(Count("team"), 2);
}

TEST_F(TeamsTest, AChangeThatFailsLeavesNoLook) {
  EXPECT_FALSE(
      store_
          ->Write([&](Transaction& writer) -> absl::Status {
            EXPECT_TRUE(
                writer.quotas.Grant({"alpha", "manipulation", Budget::kRanked, 1, "why"}, "u")
                    .ok());
            return absl::UnavailableError("the disk is gone");
          })
          .ok());
  EXPECT_EQ(Count("team_skeleton"), 0);
  EXPECT_TRUE(Try(kCyrillic).ok()) << "the name was nobody's";
}

TEST_F(TeamsTest, TeamsOfEarlierStoresKeepTheirNames) {
  for (const char* name : {"alpha", kCyrillic, kNoBreak, kFiller}) AddOldTeam(name);
  Open();
  for (const char* name : {"alpha", kCyrillic, kNoBreak, kFiller}) {
    EXPECT_TRUE(Try(name).ok()) << name;
    EXPECT_EQ(TeamOfLast(), name);
    Read([&](const Transaction& reader) {
      EXPECT_EQ(reader.teams.NameOf(name), name);
      EXPECT_TRUE(reader.teams.Check(name).ok());
      EXPECT_EQ(reader.submissions.List({.team = name}).rows.size(), 1u);
    });
  }
  EXPECT_EQ(Count("team"), 4);
  EXPECT_EQ(ErrorCodeOf(Try("Alpha")), "look_alike");
  EXPECT_EQ(ErrorCodeOf(Try("Team Blue")), "look_alike") << "the old one has a no-break space";
}

TEST_F(TeamsTest, LooksAreMadeAnewWhenTheRuleChanges) {
  ASSERT_TRUE(Try("alpha").ok());
  const int64_t looks = Count("team_skeleton");
  EXPECT_EQ(SqlError("UPDATE team_skeleton SET skeleton = 'of old'"), "");
  Open();
  EXPECT_TRUE(Try("Alpha").ok()) << "looks of the present rule are not made again";
  EXPECT_EQ(SqlError("UPDATE meta SET value = x'30' WHERE key = 'team_skeletons'"), "");
  Open();
  EXPECT_EQ(ErrorCodeOf(Try("ALPHA")), "look_alike");
  EXPECT_GE(Count("team_skeleton"), 2 * looks);
}

TEST_F(TeamsTest, ThousandsOfTeamsAreLookedUpByAnIndex) {
  ASSERT_TRUE(store_->Write([](Transaction& writer) -> absl::Status {
    for (int i = 0; i < 10'000; ++i) {
      absl::Status status = writer.quotas.Grant(
          {absl::StrCat("Team ", i * 2 + 1'000'002), "manipulation", Budget::kRanked, 1, "w"},
          "u");
      // 0 and O, 1 and l are alike, two numbers never are.
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }).ok());
  EXPECT_EQ(Count("team"), 10'000);
  Read([](const Transaction& reader) { EXPECT_EQ(reader.teams.List().rows.size(), 10'000u); });
  EXPECT_EQ(ErrorCodeOf(Try("TEAM 1OOOOO2")), "look_alike");
  SQLite::Database db(path_);
  SQLite::Statement plan(db, "EXPLAIN QUERY PLAN SELECT t.name FROM team_skeleton AS l JOIN team AS t "
                             "ON t.id = l.team WHERE l.skeleton = 'x' ORDER BY t.id LIMIT 1");
  while (plan.executeStep()) {
    EXPECT_THAT(plan.getColumn(3).getString(), Not(HasSubstr("SCAN")));
  }
}

}  // namespace
}  // namespace myograde::server
