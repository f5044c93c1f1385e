// Stores of every earlier schema, with configs of form 1: they open, show the same boards, and
// resume where they were. tests/server/store/old has a dump of each; the dumps never change.
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "damaged_store.h"
#include "server/engine/stored.h"
#include "server/store/schema.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

std::string TextOf(const std::string& name) {
  std::ifstream file(absl::StrCat(MYOGRADE_SOURCE_DIR "/tests/server/store/old/", name));
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

class OldStores : public testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    folder_ = absl::StrCat(testing::TempDir(), "/old-stores-", getpid(), "-", GetParam());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    SQLite::Database db(folder_ + "/old.db", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    const std::string sql = TextOf(absl::StrCat("v", GetParam(), ".sql"));
    ASSERT_FALSE(sql.empty());
    db.exec(sql);
    ASSERT_EQ(db.execAndGet("PRAGMA user_version").getInt(), GetParam());
    SQLite::Statement config(db, "SELECT config FROM submission WHERE id = 1");
    ASSERT_TRUE(config.executeStep());
    config_ = config.getColumn(0).getString();
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::vector<std::string> States(World& world) {
    std::vector<std::string> states;
    EXPECT_TRUE(world.readers->Read([&](Reader& reader) {
      const Listed<SubmissionRow> list = reader.Submissions({});
      EXPECT_THAT(list.damaged, IsEmpty());
      for (const SubmissionRow& row : list.rows) {
        const EvaluationRow original = *reader.Original(row.id);
        states.push_back(absl::StrCat(row.team, " ",
                                      std::string(EvaluationStateName(original.state)), " ",
                                      reader.Counts(original.id).done));
      }
      return absl::OkStatus();
    }).ok());
    return states;
  }

  std::string folder_;
  std::string config_;
};

// The lines of a board, each reduced to the aggregate keys that the same line of `old` has: a later
// version may report more.
std::string AsItWas(const std::string& board, const std::string& old) {
  const std::vector<std::string> lines = absl::StrSplit(board, '\n');
  const std::vector<std::string> before = absl::StrSplit(old, '\n');
  std::string text;
  for (size_t i = 0; i < lines.size(); ++i) {
    const size_t brace = lines[i].find('{');
    if (brace == std::string::npos || i >= before.size() ||
        before[i].find('{') == std::string::npos) {
      absl::StrAppend(&text, i > 0 ? "\n" : "", lines[i]);
      continue;
    }
    auto now = nlohmann::json::parse(lines[i].substr(brace));
    const auto then = nlohmann::json::parse(before[i].substr(before[i].find('{')));
    for (auto it = now.begin(); it != now.end();) {
      it = then.contains(it.key()) ? std::next(it) : now.erase(it);
    }
    absl::StrAppend(&text, i > 0 ? "\n" : "", lines[i].substr(0, brace), now.dump());
  }
  return text;
}

TEST_P(OldStores, ShowTheSameBoardsAndPlayOn) {
  World world(folder_ + "/world", {}, 2, folder_ + "/old.db");
  ASSERT_EQ(world.broken, "");
  const auto damaged = FillStandings(*world.store, *world.readers);
  ASSERT_TRUE(damaged.ok()) << damaged.status();
  EXPECT_THAT(*damaged, IsEmpty());
  const std::string board = BoardText(*world.readers, config_);
  const std::string old = TextOf(absl::StrCat("v", GetParam(), ".board"));
  EXPECT_EQ(AsItWas(board, old), old);
  EXPECT_THAT(States(world), ElementsAre("other queued 0", "other queued 0", "victim running 2",
                                         "other done 6", "victim done 6"));
  for (int i = 0; i < 1000 && !world.AllEnded(); ++i) world.RunOnce();
  EXPECT_EQ(world.broken, "");
  EXPECT_THAT(States(world), ElementsAre("other done 2", "other done 4", "victim done 4",
                                         "other done 6", "victim done 6"));
  ASSERT_TRUE(world.readers->Read([&](Reader& reader) {
    for (const int64_t evaluation : {1, 2, 3, 4, 5}) {
      EXPECT_THAT(*reader.Repeats(evaluation), IsEmpty()) << "played as before";
    }
    return reader.Export([](std::string_view) { return true; });
  }).ok());
  EXPECT_NE(world.Submit("new", 2), 0);
}

// From version 6 on a team has members; in earlier versions whoever handed in for it was one.
TEST(OldStoresTest, WhoHandedInForATeamIsItsMember) {
  const std::string path = absl::StrCat(testing::TempDir(), "/old-members-", getpid(), ".db");
  fs::remove(path);
  SQLite::Database(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(TextOf("v5.sql"));
  ManualClock clock;
  ASSERT_TRUE(Store::Open(path, clock).ok());
  EXPECT_TRUE(ReaderPool(path).Read([&](Reader& reader) {
    EXPECT_THAT(reader.TeamsOf("uid 1001"), ElementsAre("victim"));
    EXPECT_THAT(reader.TeamsOf("uid 1003"), ElementsAre("other"));
    EXPECT_THAT(reader.Team("victim")->members, ElementsAre("uid 1001", "uid 1002"));
    EXPECT_THAT(reader.Team("other")->members, ElementsAre("uid 1003")) << "\"test\" is no user";
    const std::vector<MemberRow> members = reader.Members("other").rows;
    EXPECT_EQ(members.size(), 1u) << "once, though two of its submissions are that user's";
    EXPECT_EQ(members.at(0).since, 1728000060000) << "since the first of them";
    EXPECT_EQ(members.at(0).who, "migration");
    return absl::OkStatus();
  }).ok());
  fs::remove(path);
}

// What people did in version 6 stands, and evaluations may be rejudges from version 7 on.
TEST(OldStoresTest, PeopleAndPhasesOfVersionSixStand) {
  const std::string path = absl::StrCat(testing::TempDir(), "/old-people-", getpid(), ".db");
  fs::remove(path);
  SQLite::Database(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(TextOf("v6.sql"));
  ManualClock clock;
  ASSERT_TRUE(Store::Open(path, clock).ok());
  EXPECT_TRUE(ReaderPool(path).Read([&](Reader& reader) {
    EXPECT_THAT(reader.Team("victim")->members, ElementsAre("uid 1001"));
    EXPECT_THAT(reader.Team("other")->members, ElementsAre("uid 1003", "uid 1004"));
    EXPECT_EQ(reader.TeamOf("fifth"), "last") << "merged";
    EXPECT_EQ(reader.TeamOf("third"), "last") << "renamed";
    EXPECT_TRUE(reader.Team("fourth")->banned);
    EXPECT_EQ(reader.Tokens().rows.size(), 2u);
    EXPECT_EQ(reader.PhaseEvents("final")->size(), 3u);
    EXPECT_EQ(reader.PhaseSecret("final")->size(), 32u);
    EXPECT_THAT(reader.Rejudges().rows, IsEmpty());
    const EvaluationRow row = *reader.Original(1);
    EXPECT_EQ(row.config, "") << "the submission's";
    return absl::OkStatus();
  }).ok());
  SQLite::Database db(path);
  EXPECT_EQ(db.execAndGet("PRAGMA integrity_check").getString(), "ok");
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM sqlite_schema WHERE name = 'evaluation' AND "
                          "sql LIKE '%''rejudge''%'").getInt(), 1);
  fs::remove(path);
}

TEST(OldStoresTest, FromVersionElevenOnDenialsMayGoAndExactIntervalsAreMadeAgain) {
  const std::string path = absl::StrCat(testing::TempDir(), "/old-denials-", getpid(), ".db");
  fs::remove(path);
  {
    SQLite::Database old(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    old.exec(TextOf("v10.sql"));
    old.exec("UPDATE access_event SET count = 5; INSERT INTO access_event (at, kind, who, role, action, "
             "subject, detail) VALUES (1, 'act', 'uid 0', 'operator', 'mark', '', '')");
    EXPECT_EQ(old.execAndGet("SELECT count(*) FROM standing").getInt(), 2);
  }
  ManualClock clock;
  auto store = Store::Open(path, clock);
  ASSERT_TRUE(store.ok()) << store.status();
  SQLite::Database db(path, SQLite::OPEN_READWRITE);
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM standing WHERE successes IN (0, episodes)").getInt(), 0);
  EXPECT_EQ(db.exec("DELETE FROM access_event WHERE kind = 'denied'"), 2);
  EXPECT_THROW(db.exec("DELETE FROM access_event"), SQLite::Exception);
  fs::remove(path);
}

INSTANTIATE_TEST_SUITE_P(Versions, OldStores,
                         testing::Range(1, static_cast<int>(SchemaMigrations().size())));

}  // namespace
}  // namespace myograde::server
