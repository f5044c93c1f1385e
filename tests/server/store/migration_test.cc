// Before a store of an earlier schema is migrated, a copy of it is kept; without the copy nothing
// changes. A store of a later schema is refused, and so is one from before the first release.
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "server/store/connection.h"
#include "store_fixture.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// This program's schema and two steps of later ones.
const std::vector<const char*> kSteps = {
    SchemaMigrations()[0],
    "ALTER TABLE team ADD COLUMN motto TEXT NOT NULL DEFAULT 'none'",
    "CREATE TABLE trophy (id INTEGER PRIMARY KEY, team INTEGER NOT NULL) STRICT; "
    "INSERT INTO trophy (team) SELECT id FROM team",
};
constexpr int kNewest = 3;
constexpr int kOfThisProgram = 1;

class MigrationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "migration-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    path_ = dir_ + "/store.db";
    spdlog::set_default_logger(std::make_shared<spdlog::logger>(
        "", std::make_shared<spdlog::sinks::ostream_sink_mt>(log_)));
  }
  void TearDown() override {
    spdlog::set_default_logger(before_);
    fs::remove_all(dir_);
  }

  // A store of this version, with rows.
  void Make(int version) {
    fs::remove_all(dir_);
    fs::create_directory(dir_);
    ASSERT_TRUE(Open(version).ok());
    SQLite::Database(path_, SQLite::OPEN_READWRITE)
        .exec("INSERT INTO team (name, created_at) VALUES ('alpha', 1), ('beta', 2)");
  }

  // As a program does that knows so many schemas.
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Open(int known = kNewest) {
    log_.str("");
    return OpenForWriting(path_, Migrations(kSteps).first(static_cast<size_t>(known)));
  }

  static int Number(const std::string& path, const std::string& sql) {
    return SQLite::Database(path).execAndGet(sql).getInt();
  }

  std::vector<std::string> Files() const {
    std::vector<std::string> names;
    for (const fs::directory_entry& entry : fs::directory_iterator(dir_)) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }

  std::string dir_;
  std::string path_;
  ManualClock clock_;
  std::ostringstream log_;  // of the latest Open
  const std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
};

TEST_F(MigrationTest, EveryVersionIsCopiedAsItWasAndOnce) {
  for (int version = 1; version < kNewest; ++version) {
    SCOPED_TRACE(version);
    Make(version);
    {
      const auto store = Open();
      ASSERT_TRUE(store.ok()) << store.status();
      EXPECT_THAT(log_.str(), HasSubstr(absl::StrCat(
                                  "migrated the store from schema ", version, " to ", kNewest, "; ",
                                  path_, ".schema-", version, " is a copy of the old one")));
    }
    const std::string copy = CopyBeforeMigration(path_, version);
    EXPECT_EQ(Number(copy, "PRAGMA user_version"), version);
    EXPECT_EQ(Number(copy, "SELECT count(*) FROM team"), 2);
    EXPECT_EQ(Number(copy, "SELECT count(*) FROM sqlite_schema WHERE name = 'trophy'"), 0);
    EXPECT_EQ(SQLite::Database(copy).execAndGet("PRAGMA integrity_check").getString(), "ok");
    struct stat status = {};
    ASSERT_EQ(stat(copy.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0600u);
    EXPECT_EQ(Number(path_, "PRAGMA user_version"), kNewest);
    EXPECT_EQ(Number(path_, "SELECT count(*) FROM trophy"), 2);
    EXPECT_EQ(Number(path_, "SELECT count(*) FROM team WHERE motto = 'none'"), 2);

    fs::remove(copy);
    const auto again = Open();
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_THAT(log_.str(), testing::Not(HasSubstr("migrated")));
    EXPECT_FALSE(fs::exists(copy)) << "nothing to copy";
  }
}

TEST_F(MigrationTest, AStepThatFailsChangesNothing) {
  Make(1);
  std::vector<const char*> steps = kSteps;
  steps[2] = "CREATE TABLE trophy (id INTEGER PRIMARY KEY) STRICT; INSERT INTO nothing VALUES (1)";
  EXPECT_FALSE(OpenForWriting(path_, steps).ok());
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), 2) << "the step before it is done";
  EXPECT_EQ(Number(path_, "SELECT count(*) FROM sqlite_schema WHERE name = 'trophy'"), 0);
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(Number(path_, "SELECT count(*) FROM trophy"), 2);
}

TEST_F(MigrationTest, ANewStoreHasNoCopy) {
  const auto store = Store::Open(path_, clock_);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_THAT(log_.str(), testing::Not(HasSubstr("migrated")));
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("schema")));
}

TEST_F(MigrationTest, ARestoredCopyIsMigratedAgain) {
  Make(2);
  ASSERT_TRUE(Open().ok());
  const std::string copy = CopyBeforeMigration(path_, 2);
  for (const char* part : {"", "-wal", "-shm"}) fs::remove(path_ + part);
  fs::copy_file(copy, path_);
  SQLite::Database(path_, SQLite::OPEN_READWRITE)
      .exec("UPDATE team SET name = 'since then' WHERE id = 1");
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(Number(copy, "SELECT count(*) FROM team WHERE name = 'since then'"), 1)
      << "the later state takes the place of the earlier one";
}

TEST_F(MigrationTest, TheLatestTwoCopiesAreKept) {
  Make(2);
  for (const char* name : {"schema-0", "schema-1", "schema-", "schema-5x", "mine"}) {
    std::ofstream(absl::StrCat(path_, ".", name)) << "kept";
  }
  ASSERT_TRUE(Open().ok());
  EXPECT_THAT(Files(),
              testing::IsSupersetOf({"store.db.schema-1", "store.db.schema-2", "store.db.schema-",
                                     "store.db.schema-5x", "store.db.mine"}));
  EXPECT_FALSE(fs::exists(CopyBeforeMigration(path_, 0)));
}

TEST_F(MigrationTest, WithoutRoomForTheCopyNothingChanges) {
  Make(1);
  const auto size = fs::file_size(path_);
  rlimit before;
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit tight = {size / 2, before.rlim_max};
  const auto handler = signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &tight);
  const absl::Status status = Open().status();
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, handler);
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(HasSubstr(CopyBeforeMigration(path_, 1)), HasSubstr("from 1 to "),
                             HasSubstr("stays as it is")));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), 1);
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("schema")));
  EXPECT_TRUE(Open().ok()) << "once there is room";
}

TEST_F(MigrationTest, WhatAKilledCopyLeftIsReplaced) {
  Make(2);
  std::ofstream(CopyBeforeMigration(path_, 2) + ".draft") << "half a copy";
  std::ofstream(CopyBeforeMigration(path_, 2) + ".draft-journal") << "its journal";
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(Number(CopyBeforeMigration(path_, 2), "PRAGMA user_version"), 2);
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("draft")));
}

TEST_F(MigrationTest, ADraftThatIsInTheWayIsNamed) {
  Make(2);
  fs::create_directories(CopyBeforeMigration(path_, 2) + ".draft/full");
  EXPECT_THAT(std::string(Open().status().message()), HasSubstr(".draft: can't be created"));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), 2);
}

TEST_F(MigrationTest, ANewerStoreIsRefusedAndTheWayBackIsNamed) {
  Make(kOfThisProgram);
  ASSERT_TRUE(Open().ok());
  const absl::Status status = Store::Open(path_, clock_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(HasSubstr(absl::StrCat("has schema ", kNewest)),
                             HasSubstr(absl::StrCat("restore the copy from before the upgrade, ",
                                                    CopyBeforeMigration(path_, kOfThisProgram)))));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), kNewest) << "untouched";

  std::ofstream(CopyBeforeMigration(path_, kNewest)) << "of no use to this program";
  fs::remove(CopyBeforeMigration(path_, kOfThisProgram));
  EXPECT_THAT(std::string(Store::Open(path_, clock_).status().message()),
              HasSubstr("restore a backup"));
}

// Those had the versions 1 to 11, and no application id.
TEST_F(MigrationTest, AStoreFromBeforeTheFirstReleaseIsRefusedByName) {
  for (const int version : {1, 11}) {
    fs::remove(path_);
    SQLite::Database(path_, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
        .exec(absl::StrCat(
            "CREATE TABLE submission (id INTEGER); CREATE TABLE transition (id INTEGER); "
            "PRAGMA user_version = ",
            version));
    const absl::Status status = Store::Open(path_, clock_).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
    EXPECT_THAT(std::string(status.message()),
                testing::AllOf(HasSubstr(path_), HasSubstr("from before the first release"),
                               HasSubstr(absl::StrCat("schema ", version)),
                               HasSubstr("give --data a new folder")));
    EXPECT_EQ(Number(path_, "SELECT count(*) FROM sqlite_schema"), 2) << "untouched";
  }
}

}  // namespace
}  // namespace myograde::server
