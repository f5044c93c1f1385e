// Before a store of an earlier schema is migrated, a copy of it is kept; without the copy nothing
// changes. A store of a later schema is refused. tests/server/store/old has one of each version.
#include "server/store/migration.h"

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "server/store/schema.h"
#include "store_fixture.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const int kNewest = static_cast<int>(SchemaMigrations().size());

class MigrationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "migration-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    path_ = dir_ + "/store.db";
  }
  void TearDown() override { fs::remove_all(dir_); }

  // A store of this version, with rows.
  void Make(int version) {
    fs::remove_all(dir_);
    fs::create_directory(dir_);
    std::ifstream file(
        absl::StrCat(MYOGRADE_SOURCE_DIR "/tests/server/store/old/v", version, ".sql"));
    std::stringstream sql;
    sql << file.rdbuf();
    ASSERT_FALSE(sql.str().empty());
    SQLite::Database(path_, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(sql.str());
  }

  absl::Status Open() { return Store::Open(path_, clock_).status(); }

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
};

TEST_F(MigrationTest, EveryVersionIsCopiedAsItWasAndOnce) {
  for (int version = 1; version < kNewest; ++version) {
    SCOPED_TRACE(version);
    Make(version);
    const int episodes = Number(path_, "SELECT count(*) FROM episode");
    {
      const auto store = Store::Open(path_, clock_);
      ASSERT_TRUE(store.ok()) << store.status();
      const std::optional<Migration>& done = (*store)->migration();
      ASSERT_TRUE(done.has_value());
      EXPECT_EQ(done->from, version);
      EXPECT_EQ(done->to, kNewest);
      EXPECT_EQ(done->copy, absl::StrCat(path_, ".schema-", version));
    }
    const std::string copy = CopyBeforeMigration(path_, version);
    EXPECT_EQ(Number(copy, "PRAGMA user_version"), version);
    EXPECT_EQ(Number(copy, "SELECT count(*) FROM episode"), episodes);
    EXPECT_EQ(SQLite::Database(copy).execAndGet("PRAGMA integrity_check").getString(), "ok");
    struct stat status = {};
    ASSERT_EQ(stat(copy.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0600u);
    EXPECT_EQ(Number(path_, "PRAGMA user_version"), kNewest);

    fs::remove(copy);
    const auto again = Store::Open(path_, clock_);
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_FALSE((*again)->migration().has_value());
    EXPECT_FALSE(fs::exists(copy)) << "nothing to copy";
  }
}

TEST_F(MigrationTest, ANewStoreHasNoCopy) {
  const auto store = Store::Open(path_, clock_);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_FALSE((*store)->migration().has_value());
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("schema")));
}

TEST_F(MigrationTest, ARestoredCopyIsMigratedAgain) {
  Make(8);
  ASSERT_TRUE(Open().ok());
  const std::string copy = CopyBeforeMigration(path_, 8);
  for (const char* part : {"", "-wal", "-shm"}) fs::remove(path_ + part);
  fs::copy_file(copy, path_);
  SQLite::Database(path_, SQLite::OPEN_READWRITE)
      .exec("UPDATE team SET name = 'since then' WHERE id = 1");
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(Number(copy, "SELECT count(*) FROM team WHERE name = 'since then'"), 1)
      << "the later state takes the place of the earlier one";
}

TEST_F(MigrationTest, TheLatestTwoCopiesAreKept) {
  Make(6);
  for (const char* name : {"schema-2", "schema-4", "schema-5", "schema-", "schema-5x", "mine"}) {
    std::ofstream(absl::StrCat(path_, ".", name)) << "kept";
  }
  ASSERT_TRUE(Open().ok());
  EXPECT_THAT(Files(),
              testing::IsSupersetOf({"store.db.schema-5", "store.db.schema-6", "store.db.schema-",
                                     "store.db.schema-5x", "store.db.mine"}));
  for (const int removed : {2, 4}) {
    EXPECT_FALSE(fs::exists(CopyBeforeMigration(path_, removed))) << removed;
  }
}

TEST_F(MigrationTest, WithoutRoomForTheCopyNothingChanges) {
  Make(7);
  const auto size = fs::file_size(path_);
  rlimit before;
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit tight = {size / 2, before.rlim_max};
  const auto handler = signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &tight);
  const absl::Status status = Open();
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, handler);
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(HasSubstr(CopyBeforeMigration(path_, 7)), HasSubstr("from 7 to "),
                             HasSubstr("stays as it is")));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), 7);
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("schema")));
  EXPECT_TRUE(Open().ok()) << "once there is room";
}

TEST_F(MigrationTest, WhatAKilledCopyLeftIsReplaced) {
  Make(9);
  std::ofstream(CopyBeforeMigration(path_, 9) + ".draft") << "half a copy";
  std::ofstream(CopyBeforeMigration(path_, 9) + ".draft-journal") << "its journal";
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(Number(CopyBeforeMigration(path_, 9), "PRAGMA user_version"), 9);
  for (const std::string& name : Files()) EXPECT_THAT(name, testing::Not(HasSubstr("draft")));
}

TEST_F(MigrationTest, ADraftThatIsInTheWayIsNamed) {
  Make(9);
  fs::create_directories(CopyBeforeMigration(path_, 9) + ".draft/full");
  EXPECT_THAT(std::string(Open().message()), HasSubstr(".draft: can't be made"));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), 9);
}

TEST_F(MigrationTest, ANewerStoreIsRefusedAndTheWayBackIsNamed) {
  Make(9);
  ASSERT_TRUE(Open().ok());
  SQLite::Database(path_, SQLite::OPEN_READWRITE)
      .exec(absl::StrCat("PRAGMA user_version = ", kNewest + 1));
  const absl::Status status = Open();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(HasSubstr(absl::StrCat("has schema ", kNewest + 1)),
                             HasSubstr(absl::StrCat("restore the copy from before the upgrade, ",
                                                    CopyBeforeMigration(path_, 9)))));
  EXPECT_EQ(Number(path_, "PRAGMA user_version"), kNewest + 1) << "untouched";

  std::ofstream(CopyBeforeMigration(path_, kNewest + 1)) << "of no use to this program";
  fs::remove(CopyBeforeMigration(path_, 9));
  EXPECT_THAT(std::string(Open().message()), HasSubstr("restore a backup"));
}

}  // namespace
}  // namespace myograde::server
