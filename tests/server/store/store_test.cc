// The store: state transitions, keys that count once, permanent audit rows, and clear errors if the
// file can't be used.
#include "server/store/store.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/time/clock.h>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>

#include "server/base/data_folder.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST_F(StoreTest, WritesNothingOnceItsFileIsGone) {
  const auto write = [&] { return store_->Write([](Transaction&) { return absl::OkStatus(); }); };
  for (const char* part : {"", "-wal"}) {
    ASSERT_TRUE(write().ok());
    std::filesystem::rename(path_ + part, path_ + ".away");
    EXPECT_TRUE(absl::IsUnavailable(write())) << part;
    EXPECT_NE(store_->Check().message().find("was removed while the daemon runs"),
              absl::string_view::npos);
    std::ofstream(path_ + part) << "another";
    EXPECT_NE(store_->Check().message().find("was replaced"), absl::string_view::npos);
    std::filesystem::rename(path_ + ".away", path_ + part);
    EXPECT_TRUE(write().ok()) << "it is back";
  }
  store_->Distrust("a page is damaged");
  EXPECT_TRUE(absl::IsUnavailable(write()));
}

TEST_F(StoreTest, NoticesALogThatWasCutOff) {
  const auto truncate_log = [&] { std::filesystem::resize_file(path_ + "-wal", 0); };
  Submit();
  EXPECT_EQ(SqlError("PRAGMA wal_checkpoint(TRUNCATE)"), "");
  EXPECT_TRUE(store_->Check().ok()) << "everything is in the file";
  Submit("beta", 'b');
  truncate_log();
  EXPECT_THAT(store_->Check().message(), HasSubstr("write-ahead log was cut off"));
  EXPECT_TRUE(absl::IsUnavailable(TrySubmit("gamma", 'e', true).status()));
}

TEST_F(StoreTest, NoticesAnOlderStoreInItsFile) {
  Submit();
  const std::string backup = dir_ + "/backup.db";
  ASSERT_TRUE(ReaderPool(path_).Backup(backup, [](int64_t, int64_t) {}, [](const std::string&) {}).ok());
  Submit("beta", 'b');
  EXPECT_EQ(SqlError("PRAGMA wal_checkpoint(TRUNCATE)"), "");
  EXPECT_TRUE(store_->Check().ok());
  absl::SleepFor(absl::Milliseconds(20));  // a file's time is as coarse as the kernel's ticks
  // As `cp` does: the file stays the same one.
  std::ofstream(path_, std::ios::binary) << std::ifstream(backup, std::ios::binary).rdbuf();
  EXPECT_THAT(store_->Check().message(), HasSubstr("overwritten with an older store"));
  EXPECT_TRUE(absl::IsUnavailable(TrySubmit("gamma", 'e', true).status()));
}

TEST_F(StoreTest, OpensNothingThatWasCutOff) {
  Submit();
  store_.reset();  // everything is in the file now
  const auto size = std::filesystem::file_size(path_);
  for (const int cut : {1, 4096}) {
    std::filesystem::resize_file(path_, size - static_cast<uintmax_t>(cut));
    const absl::Status opened = Store::Open(path_, clock_).status();
    EXPECT_TRUE(IsCorruptStore(opened)) << opened;
    EXPECT_THAT(opened.message(), HasSubstr("was cut off"));
  }
}

TEST_F(StoreTest, TellsOfPagesThatCantBeRead) {
  ASSERT_TRUE(TrySubmit("alpha", 'a', true).ok());
  store_.reset();  // everything is in the file now
  const auto size = std::filesystem::file_size(path_);
  {
    std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(8192);
    file << std::string(size - 8192, 'x');
  }
  ReaderPool readers(path_);
  std::string told;
  readers.SetObserver([&](absl::Duration, const absl::Status& status) {
    if (IsCorruptStore(status)) told = std::string(status.message());
  });
  const absl::Status read = readers.Read([](const Transaction& reader) {
    return reader.submissions.Find(1).status();
  });
  EXPECT_TRUE(IsCorruptStore(read)) << read;
  EXPECT_NE(told.find("is damaged"), std::string::npos);
}

TEST_F(StoreTest, ACopyOfItsFolderIsAnotherHome) {
  namespace fs = std::filesystem;
  const auto recorded = [](const std::string& path) {
    std::optional<DataHome> home;
    EXPECT_TRUE(ReaderPool(path).Read([&](const Transaction& reader) {
      home = reader.Home();
      return absl::OkStatus();
    }).ok());
    return home;
  };
  EXPECT_FALSE(recorded(path_).has_value());
  const DataHome home = *ReadDataHome(dir_);
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    writer.SetHome(home);
    return absl::OkStatus();
  }).ok());
  Open();
  EXPECT_EQ(recorded(path_)->key, home.key);
  EXPECT_THAT(recorded(path_)->place, HasSubstr(dir_ + " on host "));
  store_.reset();
  const std::string copy = dir_ + "-copy";
  fs::copy(dir_, copy, fs::copy_options::recursive);
  EXPECT_EQ(recorded(copy + "/store.db")->key, home.key) << "it tells whose copy it is";
  EXPECT_NE(ReadDataHome(copy)->key, home.key);
  fs::remove_all(copy);
  // A folder that is renamed is the same, and so is one whose contents were replaced.
  fs::rename(dir_, copy);
  EXPECT_EQ(ReadDataHome(copy)->key, home.key);
  fs::rename(copy, dir_);
}

TEST_F(StoreTest, AcceptanceNumbersRiseAndTheQueueIsThereAfterOpeningAgain) {
  const Accepted first = Submit("alpha");
  const Accepted second = Submit("beta");
  EXPECT_EQ(second.submission, first.submission + 1);
  Open();
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.evaluations.Unfinished().rows.size(), 2u);
    EXPECT_EQ(reader.submissions.Find(second.submission)->team, "beta");
    const std::vector<BlockRow> blocks = *reader.blocks.Of(first.evaluation);
    ASSERT_EQ(blocks.size(), 2u);
    EXPECT_EQ(blocks[1].first, 2);
    EXPECT_EQ(blocks[1].state, BlockState::kPending);
    EXPECT_EQ(reader.content.Artefact(std::string(64, 'a'))->runtimes,
              std::vector<std::string>{"python"});
    EXPECT_EQ(reader.submissions.List({.team = "beta"}).rows.size(), 1u);
    EXPECT_EQ(reader.submissions.List({.before = second.submission}).rows.front().id,
              first.submission);
  });
}

TEST_F(StoreTest, AnUnknownArtefactLeavesNothingBehind) {
  const absl::Status status = store_->Write([&](Transaction& writer) {
    NewSubmission submission;
    submission.artefact = std::string(64, 'f');
    submission.team = "ghost";
    return writer.submissions.Accept(submission, kRules, "uid 0").status();
  });
  EXPECT_TRUE(absl::IsNotFound(status)) << status;
  SQLite::Database db(path_);
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM team").getInt(), 0);
}

TEST_F(StoreTest, AnEpisodeCountsOnceAndADifferenceIsRemembered) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
  EXPECT_THAT(*Record(accepted, 0, 1), testing::IsEmpty());
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    return writer.blocks.Return(accepted.blocks[0], 1, true, "daemon", "the runner died");
  }).ok());
  // The old attempt is over: its records are rejected.
  EXPECT_TRUE(absl::IsFailedPrecondition(Record(accepted, 1, 1).status()));
  ASSERT_TRUE(Start(accepted.blocks[0], 2).ok());
  std::string slower = kFacts;
  slower.replace(slower.find("1.5"), 3, "9.5");
  const auto same = Record(accepted, 0, 2, slower);
  EXPECT_THAT(*same, testing::IsEmpty()) << "the clock is no part of a result";
  std::string other = kFacts;
  other.replace(other.find("aa"), 2, "bb");
  EXPECT_THAT(*Record(accepted, 0, 2, other), ElementsAre("digest"));
  Read([&](const Transaction& reader) {
    const std::vector<EpisodeRow> rows = *reader.episodes.Of(accepted.evaluation);
    ASSERT_EQ(rows.size(), 1u);
    EXPECT_EQ(rows[0].facts_json, kFacts);
    EXPECT_EQ(rows[0].attempt, 1);
    ASSERT_EQ(reader.episodes.Repeats(accepted.evaluation)->size(), 1u);
    EXPECT_EQ((*reader.blocks.Of(accepted.evaluation))[0].faults, 1);
  });
}

TEST_F(StoreTest, DetailsAreKeptBesideTheResultAndComparedWithNothing) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
  EXPECT_THAT(*Record(accepted, 0, 1, kFacts, R"({"fall_time":1.5})"), testing::IsEmpty());
  EXPECT_THAT(*Record(accepted, 1, 1), testing::IsEmpty());
  const auto again = Record(accepted, 0, 1, kFacts, R"({"fall_time":2.5})");
  EXPECT_THAT(*again, testing::IsEmpty()) << "no part of a result";
  Read([&](const Transaction& reader) {
    EXPECT_THAT(*reader.episodes.Details(accepted.evaluation),
                ElementsAre(testing::Pair(0, R"({"fall_time":1.5})")));
    EXPECT_THAT(*reader.episodes.Details(accepted.evaluation + 1), testing::IsEmpty());
    const std::vector<EpisodeRow> rows = *reader.episodes.Of(accepted.evaluation);
    EXPECT_EQ(rows.size(), 2u);
    for (const EpisodeRow& row : rows) EXPECT_EQ(row.details_json, "") << "read by themselves";
  });
  ASSERT_EQ(SqlError("DROP TRIGGER episode_details_fixed; "
                     "UPDATE episode_details SET details_json = '[]'"), "");
  Read([&](const Transaction& reader) {
    EXPECT_TRUE(absl::IsDataLoss(reader.episodes.Details(accepted.evaluation).status()));
    EXPECT_TRUE(reader.episodes.Of(accepted.evaluation).ok());
  });
}

TEST_F(StoreTest, OnlyAllowedStepsAreTaken) {
  const Accepted accepted = Submit();
  const int64_t block = accepted.blocks[0];
  const auto step = [&](const std::function<absl::Status(Transaction&)>& change) {
    return store_->Write(change).code();
  };
  const auto finish = [&](Transaction& writer) {
    return writer.blocks.Finish(block, 1, "{}", "daemon");
  };
  const auto end = [&](Transaction& writer) {
    return writer.evaluations.End(accepted.evaluation, EvaluationState::kDone, "", "", "daemon");
  };
  EXPECT_EQ(step(finish), absl::StatusCode::kFailedPrecondition) << "it does not run";
  EXPECT_EQ(Start(block, 2).code(), absl::StatusCode::kFailedPrecondition) << "attempt 1 is next";
  EXPECT_EQ(Start(block, 1).code(), absl::StatusCode::kOk);
  EXPECT_EQ(Start(block, 1).code(), absl::StatusCode::kOk) << "told twice";
  EXPECT_EQ(step(finish), absl::StatusCode::kFailedPrecondition) << "episodes are missing";
  ASSERT_TRUE(Record(accepted, 0, 1).ok() && Record(accepted, 1, 1).ok());
  EXPECT_EQ(step(end), absl::StatusCode::kFailedPrecondition) << "blocks are open";
  EXPECT_EQ(step(finish), absl::StatusCode::kOk);
  EXPECT_EQ(step([&](Transaction& writer) {
    return writer.blocks.End(accepted.blocks[1], BlockState::kCancelled, false, "uid 0", "enough");
  }), absl::StatusCode::kOk);
  EXPECT_EQ(step([&](Transaction& writer) {
    return writer.evaluations.End(accepted.evaluation, EvaluationState::kCancelled, "enough", "",
                                "uid 0");
  }), absl::StatusCode::kOk);
  EXPECT_EQ(step(end), absl::StatusCode::kFailedPrecondition) << "what ended stays ended";
  Read([&](const Transaction& reader) {
    std::vector<std::string> steps;
    const std::vector<TransitionRow> history = *reader.evaluations.Transitions("block", block);
    for (const TransitionRow& row : history) {
      steps.push_back(row.from + ">" + row.to);
    }
    EXPECT_THAT(steps, ElementsAre(">pending", "pending>running", "running>done"));
    EXPECT_TRUE(reader.evaluations.Unfinished().rows.empty());
  });
}

TEST_F(StoreTest, TheSchemaRefusesToRewriteThePast) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
  ASSERT_TRUE(Record(accepted, 0, 1, kFacts, "{}").ok());
  const std::pair<const char*, const char*> attempts[] = {
      {"UPDATE transition SET why = 'x'", "never changed"},
      {"DELETE FROM transition", "never deleted"},
      {"UPDATE episode SET facts_json = '{}'", "never changed"},
      {"UPDATE episode_details SET details_json = '{}'", "never changed"},
      {"DELETE FROM episode_details", "never deleted"},
      {"DELETE FROM episode", "never deleted"},
      {"UPDATE config SET content_json = ''", "never changed"},
      {"UPDATE evaluation SET state = 'finished'", "CHECK"},
      {"UPDATE block SET state = 'running' WHERE state = 'pending'", "CHECK"},
      {"UPDATE block SET slot = NULL WHERE state = 'running'", "CHECK"},
      {"UPDATE submission SET ranked = 2", "CHECK"},
      {"UPDATE submission SET ranked = 'yes'", "cannot store TEXT"},
      {"INSERT INTO episode SELECT evaluation, 3, block, attempt, seed, outcome, reason, "
       "facts_json, metrics_json, recorded_at, log FROM episode", "block of its evaluation"},
      {"INSERT INTO evaluation (submission, kind, first, last, state, grader_json, created_at) "
       "VALUES (1, 'original', 0, 1, 'queued', '{}', 0)", "UNIQUE"},
  };
  for (const auto& [sql, error] : attempts) EXPECT_THAT(SqlError(sql), HasSubstr(error)) << sql;
}

TEST_F(StoreTest, ALockedStoreIsToldAndTheSameChangeSucceedsLater) {
  const Accepted accepted = Submit();
  {
    SQLite::Database other(path_, SQLite::OPEN_READWRITE);
    SQLite::Transaction holds(other, SQLite::TransactionBehavior::IMMEDIATE);
    const absl::Status status = Start(accepted.blocks[0], 1);
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("locked by another process"));
  }
  EXPECT_TRUE(Start(accepted.blocks[0], 1).ok());
}

TEST_F(StoreTest, AFullDiskIsToldAndLosesNothing) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
  // A limit on file size stands in for a full disk: writes beyond it fail.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before;
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit tight = {std::filesystem::file_size(path_ + "-wal"), before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &tight);
  const absl::Status status = Record(accepted, 0, 1).status();
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()), HasSubstr(path_));
  EXPECT_THAT(*Record(accepted, 0, 1), testing::IsEmpty());
  Open();
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.episodes.Counts(accepted.evaluation).done, 1);
  });
}

TEST_F(StoreTest, StrangeFilesAreRefusedWithASentence) {
  store_.reset();
  const std::string junk = dir_ + "/junk.db";
  FILE* file = fopen(junk.c_str(), "w");
  for (int i = 0; i < 1000; ++i) fputs("this is not a database\n", file);
  fclose(file);
  const absl::Status damaged = Store::Open(junk, clock_).status();
  EXPECT_TRUE(absl::IsDataLoss(damaged)) << damaged;

  const std::string foreign = dir_ + "/foreign.db";
  SQLite::Database(foreign, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
      .exec("CREATE TABLE recipe (name TEXT)");
  EXPECT_THAT(std::string(Store::Open(foreign, clock_).status().message()),
              HasSubstr("something else"));

  SQLite::Database(path_, SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 99");
  EXPECT_THAT(std::string(Store::Open(path_, clock_).status().message()),
              HasSubstr("has schema 99"));
  EXPECT_TRUE(absl::IsPermissionDenied(Store::Open(dir_ + "/no/store.db", clock_).status()));
}

TEST_F(StoreTest, OneDaemonAtATime) {
  {
    const auto first = DataLock::Take(dir_);
    ASSERT_TRUE(first.ok()) << first.status();
    const absl::Status second = DataLock::Take(dir_).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(second));
    EXPECT_THAT(std::string(second.message()), HasSubstr(std::to_string(getpid())));
    // Somebody tidied up.
    ASSERT_EQ(unlink((dir_ + "/lock").c_str()), 0);
    EXPECT_TRUE(absl::IsFailedPrecondition(DataLock::Take(dir_).status()));
    EXPECT_NE(access((dir_ + "/lock").c_str(), F_OK), 0) << "it was written again";
  }
  EXPECT_TRUE(DataLock::Take(dir_).ok());
}

}  // namespace
}  // namespace myograde::server
