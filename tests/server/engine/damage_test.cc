// One damaged row: whatever needs it fails with an error that names it, its evaluation ends, and
// everything else goes on unaffected. Every column of every table is overwritten.
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <tuple>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "damaged_store.h"
#include "server/engine/stored.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::AnyOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// The last two can be read as JSON, and lack what it should have.
const char* const kValues[] = {"NULL", "'garbage'", "x'00ff'", "9223372036854775807", "-1",
                               "'{}'", "'[]'"};

class DamageTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    const bool memory = access("/dev/shm", W_OK) == 0;
    folder_ = absl::StrCat(memory ? "/dev/shm" : testing::TempDir(), "/damage-test-", getpid());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    teams_ = MakeTwoTeams(folder_);
    World undisturbed(folder_ + "/world", {}, 2, teams_.store);
    RunFor(undisturbed, absl::Minutes(1));
    board_ = BoardText(*undisturbed.readers, teams_.other.config);
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  static std::string Copy() {
    const std::string copy = folder_ + "/copy.db";
    fs::copy_file(teams_.store, copy, fs::copy_options::overwrite_existing);
    return copy;
  }

  static void RunFor(World& world, absl::Duration time) {
    const absl::Duration until = world.clock.Monotonic() + time;
    while (world.clock.Monotonic() < until && world.broken.empty()) world.RunOnce();
  }

  // The state, or what is wrong with its row.
  static std::string StateOf(World& world, int64_t evaluation) {
    std::string state;
    const absl::Status status = world.readers->Read([&](const Transaction& reader) {
      const absl::StatusOr<EvaluationRow> row = reader.evaluations.Find(evaluation);
      state = row.ok() ? std::string(EnumName(row->state)) : std::string(row.status().message());
      return absl::OkStatus();
    });
    return status.ok() ? state : std::string(status.message());
  }

  // What a damaged row must not stop.
  static void CheckReading(World& world) {
    const absl::Status status = world.readers->Read([&](const Transaction& reader) -> absl::Status {
      const Listed<SubmissionRow> list = reader.submissions.List({});
      EXPECT_GE(list.found(), 4);
      for (const SubmissionRow& row : list.rows) {
        for (const absl::Status& read : {reader.evaluations.Original(row.id).status(),
                                         reader.content.Artefact(row.artefact).status(),
                                         reader.content.Text(kConfigs, row.config).status()}) {
          EXPECT_TRUE(read.ok() || ExtractDamage(read)) << read;
        }
        (void)reader.quotas.Ledger(row.team, "", INT64_MAX, 100);
        EXPECT_LT(reader.quotas.CountQuotaUse(row.team, row.track, 0).day, 30'000)
            << "of year 2052";
      }
      EXPECT_THAT(reader.teams.OfPerson("uid 1002"), ElementsAre("other"));
      EXPECT_THAT(reader.teams.OfPerson("uid 1001"), Not(Contains("other")));
      EXPECT_GE(reader.teams.List().found(), 2);
      EXPECT_TRUE(reader.teams.Find("other").ok());
      EXPECT_THAT(reader.teams.Members("other").damaged, testing::IsEmpty());
      (void)reader.teams.Find("victim");
      (void)reader.teams.Events("victim");
      EXPECT_TRUE(reader.callers.TokenByHash(std::string(64, 'b')).ok());
      const Listed<TokenRow> tokens = reader.callers.Tokens();
      EXPECT_LE(tokens.found() - std::ssize(tokens.rows), 1);
      (void)reader.episodes.NeededLogs();
      (void)reader.content.ArtefactUses();
      return reader.Export([](std::string_view) { return true; });
    });
    EXPECT_TRUE(status.ok()) << status;
    EXPECT_TRUE(MakeStandings(*world.readers, /*missing_only=*/false).ok());
    const std::string backup = folder_ + "/backup.db";
    fs::remove(backup);
    const absl::Status kept = world.readers->Backup(
        backup, [](int64_t, int64_t) {}, [](const std::string&) {});
    EXPECT_TRUE(kept.ok()) << kept;
  }

  static void CheckOthers(World& world) {
    EXPECT_EQ(StateOf(world, teams_.other.done), "done");
    EXPECT_EQ(StateOf(world, teams_.other.open), "done");
    EXPECT_EQ(StateOf(world, teams_.other.queued), "done");
    EXPECT_EQ(BoardText(*world.readers, teams_.other.config), board_);
  }

  static void CheckVictim(World& world) {
    const LiveHealth health = world.core->Health();
    if (health.unreadable.contains(teams_.victim.open)) return;  // reported
    EXPECT_THAT(StateOf(world, teams_.victim.open),
                AnyOf("done", "grader_error", HasSubstr("can't be read"),
                      HasSubstr("there is no evaluation")));
  }

  static void Try(const Target& target, const std::string& value) {
    SCOPED_TRACE(absl::StrCat("UPDATE ", target.table, " SET ", target.column, " = ", value,
                              " WHERE ", target.where));
    const std::string store = Copy();
    if (!Overwrite(store, target, value)) return;
    ++tried_;
    World world(folder_ + "/world", {}, 2, store);
    world.JumpClock(absl::Hours(24 * 20'000));
    RunFor(world, absl::Minutes(1));
    EXPECT_EQ(world.broken, "");
    if (!world.broken.empty()) return;
    CheckOthers(world);
    CheckVictim(world);
    CheckReading(world);
    world.Boot();
    RunFor(world, absl::Seconds(5));
    EXPECT_EQ(world.broken, "") << "at the next start";
    EXPECT_NE(world.Submit("new", 2), 0) << "others can submit";
  }

  static inline std::string folder_;
  static inline TwoTeams teams_;
  static inline std::string board_;  // the other team's, after everything has ended
  static inline int tried_ = 0;
};

TEST_F(DamageTest, WithoutItAllEnds) {
  EXPECT_THAT(board_, HasSubstr("1 other "));
  World world(folder_ + "/world", {}, 2, teams_.store);
  RunFor(world, absl::Minutes(1));
  EXPECT_EQ(world.broken, "");
  CheckOthers(world);
  EXPECT_EQ(StateOf(world, teams_.victim.open), "done");
  CheckReading(world);
}

// Every third column with one of the values; the slow tests take all columns, each with all values.
TEST_F(DamageTest, ADamagedRowIsItsOwnersHarmAlone) {
  const bool all = std::getenv("MYOGRADE_ALL_DAMAGE") != nullptr;
  const std::vector<Target> targets = TargetsIn(teams_);
  EXPECT_GT(targets.size(), 150u);
  constexpr size_t kEvery = 3;
  size_t number = 0;
  for (const Target& target : targets) {
    const size_t one = number++ % std::size(kValues);
    if (!all && number % kEvery != 0) continue;
    for (size_t i = 0; i < std::size(kValues); ++i) {
      if (all || i == one) Try(target, kValues[i]);
    }
    if (HasFailure()) break;
  }
  EXPECT_GT(tried_, all ? 600 : 40);
}

TEST_F(DamageTest, AnImportRefusesWhatNoRequestCouldRead) {
  const auto import = [](const std::string& store, const std::string& name) {
    const std::string file = folder_ + "/export.json";
    std::ofstream text(file);
    EXPECT_TRUE(ReaderPool(store).Read([&](const Transaction& reader) {
      return reader.Export([&](std::string_view part) { return bool(text << part); });
    }).ok());
    text.close();
    const absl::StatusOr<ExportInfo> info = CheckExport(file);
    EXPECT_TRUE(info.ok()) << info.status();
    const auto into = Store::Open(folder_ + "/" + name, SystemClock());
    return (*into)->Write([&](Transaction& writer) {
      return writer.Import(file, *info, "test", CheckReadable);
    });
  };
  const absl::Status whole = import(Copy(), "whole.db");
  EXPECT_TRUE(whole.ok()) << whole;
  const Target artefact = {"artefact", "hash = (SELECT min(hash) FROM artefact)", ""};
  const std::string done = absl::StrCat("evaluation = ", teams_.victim.done);
  const Target block = {
      "block", absl::StrCat("id = (SELECT min(id) FROM block WHERE ", done, ")"), ""};
  const Target episode = {"episode", absl::StrCat(done, " AND idx = 0"), ""};
  const Target evaluation = {"evaluation", absl::StrCat("id = ", teams_.victim.done), ""};
  int number = 0;
  for (const auto& [target, column, value] :
       {std::tuple(artefact, "manifest_json", "json_set(manifest_json, '$.command', json('[]'))"),
        std::tuple(artefact, "manifest_json", "json_set(manifest_json, '$.env', json('[]'))"),
        std::tuple(artefact, "manifest_json",
                   "json_set(manifest_json, '$.image', json('{\"environment\":{},\"gid\":1,"
                   "\"uid\":-1,\"working_dir\":\"/\"}'))"),
        std::tuple(Target{"config", absl::StrCat("hash = '", teams_.victim.config, "'"), ""},
                   "content_json", "'{}'"),
        std::tuple(block, "faults", "999"), std::tuple(episode, "metrics_json", "'{}'"),
        std::tuple(episode, "facts_json", "'{}'"), std::tuple(evaluation, "finished_at", "0"),
        std::tuple(evaluation, "results_hash", "hex(zeroblob(32))")}) {
    SCOPED_TRACE(column);
    const std::string store = Copy();
    ASSERT_TRUE(Overwrite(store, {target.table, target.where, column}, value));
    const absl::Status refused = import(store, absl::StrCat("into", ++number, ".db"));
    EXPECT_TRUE(absl::IsInvalidArgument(refused)) << refused;
    EXPECT_THAT(refused.message(), HasSubstr(absl::StrCat(target.table, " ")));
  }
}

TEST_F(DamageTest, AnEvaluationThatCantBeReadEndsWithTheReasonAndGivesItsQuotaBack) {
  const std::string store = Copy();
  ASSERT_TRUE(Overwrite(store, {"config", absl::StrCat("hash = '", teams_.victim.config, "'"),
                                "content_json"}, "'{\"form\": 1}'"));
  World world(folder_ + "/world", {}, 2, store);
  RunFor(world, absl::Minutes(1));
  EXPECT_EQ(world.broken, "");
  ASSERT_TRUE(world.readers->Read([&](const Transaction& reader) {
    const EvaluationRow row = *reader.evaluations.Find(teams_.victim.open);
    EXPECT_EQ(row.state, EvaluationState::kGraderError);
    // Detected by its hash, before the text is examined.
    EXPECT_THAT(row.reason, HasSubstr(absl::StrCat("config ", teams_.victim.config,
                                                   " of the store can't be read: its content has "
                                                   "another hash")));
    const std::vector<BlockRow> blocks = *reader.blocks.Of(row.id);
    for (const BlockRow& block : blocks) EXPECT_TRUE(IsFinal(block.state));
    const Listed<LedgerRow> ledger = reader.quotas.Ledger("victim", "", INT64_MAX, 1);
    EXPECT_EQ(ledger.rows.front().entry, "refund");
    EXPECT_EQ(ledger.rows.front().submission, row.submission);
    return absl::OkStatus();
  }).ok());
}

// An evaluation's journal entries can be rejected as well.
TEST_F(DamageTest, DamageWhileItRunsIsTheSame) {
  const std::string open = absl::StrCat(teams_.victim.open);
  const std::string one = "WHERE id = (SELECT min(id) FROM block WHERE state = 'running' AND "
                          "evaluation = " + open + ")";
  for (const std::string& damage :
       {"UPDATE block SET state = 'asleep' " + one, "UPDATE block SET attempt = 7 " + one,
        "UPDATE evaluation SET state = 'asleep' WHERE id = " + open}) {
    SCOPED_TRACE(damage);
    World world(folder_ + "/world", {}, 2, teams_.store);
    RunFor(world, absl::Seconds(2));
    {
      SQLite::Database db(folder_ + "/world/store.db", SQLite::OPEN_READWRITE);
      db.exec("PRAGMA ignore_check_constraints = ON");
      ASSERT_EQ(db.exec(damage), 1);
    }
    RunFor(world, absl::Minutes(1));
    EXPECT_EQ(world.broken, "");
    CheckOthers(world);
    EXPECT_EQ(StateOf(world, teams_.victim.open), "grader_error");
    EXPECT_TRUE(world.core->idle());
  }
}

TEST_F(DamageTest, WhatWaitsToBeTakenUpCanBeCancelled) {
  World world(folder_ + "/world", {}, 2);
  // The daemon's own connection goes on; a new connection can't read what it takes for a journal.
  EXPECT_FALSE(world.readers->Read([](const Transaction&) -> absl::Status {
    throw SQLite::Exception("this connection is given up");
  }).ok());
  const std::string in_the_way = folder_ + "/world/store.db-journal";
  fs::create_directory(in_the_way);
  const int64_t evaluation = world.Submit("a", 4);
  ASSERT_NE(evaluation, 0);
  EXPECT_TRUE(world.core->Running().empty()) << "it could not be read";
  std::optional<absl::Status> answer;
  const auto cancel = [&] {
    world.core->Cancel({.submission = 1, .reruns = true, .why = "why", .who = "who"},
                       [&](absl::StatusOr<CancelReport> report) { answer = report.status(); });
  };
  cancel();
  ASSERT_TRUE(answer.has_value());
  EXPECT_TRUE(answer->ok()) << *answer;
  fs::remove(in_the_way);
  RunFor(world, absl::Seconds(5));
  EXPECT_EQ(StateOf(world, evaluation), "cancelled");
  EXPECT_TRUE(world.core->idle());
  EXPECT_TRUE(world.core->Health().unreadable.empty());
  cancel();
  EXPECT_TRUE(absl::IsFailedPrecondition(*answer)) << *answer;
  EXPECT_EQ(world.broken, "");
}

}  // namespace
}  // namespace myograde::server
