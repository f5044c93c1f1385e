// Which files may be removed: decided for a whole sweep, and again for each file when its row is
// written.
#include <gtest/gtest.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

const std::string kLogHash(64, '1');
const std::string kOtherLog(64, '2');

class RemovalTest : public StoreTest {
 protected:
  static std::string FactsWith(const std::string& log) {
    return R"({"digest":"aa","log":{"sha256":")" + log + R"("},"steps":1000})";
  }

  absl::Status Write(const std::function<absl::Status(Transaction&)>& change) {
    return store_->Write(change);
  }

  bool Remove(const std::string& kind, const std::string& name) {
    bool removed = false;
    const absl::Status status = Write([&](Transaction& writer) -> absl::Status {
      const absl::StatusOr<bool> row = writer.content.Remove(kind, name, 10, "too old");
      if (row.ok()) removed = *row;
      return row.status();
    });
    EXPECT_TRUE(status.ok()) << status;
    return removed;
  }

  // The sweep's answer, and that of each removal: they must agree.
  bool MayGo(char artefact) {
    const std::string hash(64, artefact);
    bool needed = false;
    Read([&](const Transaction& reader) {
      for (const ArtefactUse& use : reader.content.ArtefactUses())
        needed |= use.hash == hash && use.needed;
    });
    const bool removed = Remove("artefact", hash);
    EXPECT_EQ(removed, !needed) << artefact;
    return removed;
  }
  bool LogMayGo(const std::string& log) {
    bool needed = false;
    Read([&](const Transaction& reader) { needed = reader.episodes.NeededLogs().contains(log); });
    const bool removed = Remove("log", log);
    EXPECT_EQ(removed, !needed) << log;
    return removed;
  }

  // Plays the first episode, whose log is `log`.
  void PlayFirst(const Accepted& accepted, const std::string& log) {
    ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
    ASSERT_TRUE(Record(accepted, 0, 1, FactsWith(log)).ok());
  }

  void End(const Accepted& accepted, EvaluationState state) {
    const absl::Status status = Write([&](Transaction& writer) {
      absl::Status written;
      for (const int64_t block : accepted.blocks) {
        written.Update(writer.blocks.End(block, BlockState::kCancelled, false, "daemon", "over"));
      }
      written.Update(writer.evaluations.End(accepted.evaluation, state, "", "", "daemon"));
      return written;
    });
    ASSERT_TRUE(status.ok()) << status;
  }

  int64_t Count(const std::string& sql) {
    return SQLite::Database(path_).execAndGet(sql).getInt64();
  }
};

TEST_F(RemovalTest, WhatHasNotEndedOrMayStandOnABoardStays) {
  char letter = 'a';
  for (const bool ranked : {true, false}) {
    for (const EvaluationState state :
         {EvaluationState::kDone, EvaluationState::kFailed, EvaluationState::kCancelled,
          EvaluationState::kGraderError}) {
      const std::string log(64, letter);
      const absl::StatusOr<Accepted> accepted = TrySubmit("alpha", letter, ranked);
      ASSERT_TRUE(accepted.ok()) << accepted.status();
      EXPECT_FALSE(MayGo(letter)) << "it waits";
      PlayFirst(*accepted, log);
      EXPECT_FALSE(MayGo(letter)) << "it runs";
      EXPECT_FALSE(LogMayGo(log)) << "it runs";
      End(*accepted, state);
      const bool stands = ranked && state == EvaluationState::kDone;
      EXPECT_EQ(MayGo(letter), !stands) << EnumName(state);
      EXPECT_EQ(LogMayGo(log), !stands) << EnumName(state);
      ++letter;
      if (letter == 'g') letter = '3';
    }
  }
}

TEST_F(RemovalTest, WhatNobodyEverUsedGoesAndEachRemovalIsARow) {
  ASSERT_TRUE(Write([](Transaction& writer) {
                return writer.content
                    .AddArtefact({{"walker", {"./policy"}}, std::string(64, '9'), 10, 2})
                    .status();
              }).ok());
  EXPECT_TRUE(MayGo('9'));
  EXPECT_TRUE(LogMayGo(kLogHash));
  EXPECT_EQ(Count("SELECT count(*) FROM removal WHERE kind = 'artefact' AND bytes = 10 AND "
                  "why = 'too old' AND name = printf('%s', '" + std::string(64, '9') + "')"), 1);
  EXPECT_EQ(Count("SELECT count(*) FROM removal WHERE kind = 'log' AND name = '" + kLogHash + "'"),
            1);
}

TEST_F(RemovalTest, WhatIsNeededLeavesNoRow) {
  PlayFirst(Submit("alpha", 'a'), kLogHash);
  EXPECT_FALSE(MayGo('a'));
  EXPECT_FALSE(LogMayGo(kLogHash));
  EXPECT_TRUE(LogMayGo(kOtherLog));
  EXPECT_EQ(Count("SELECT count(*) FROM removal"), 1);
}

// A rerun of a practice evaluation that ended long ago needs its files again, and produces the
// same logs.
TEST_F(RemovalTest, ALaterEvaluationNeedsTheFilesOfAnEarlierOne) {
  const absl::StatusOr<Accepted> practice = TrySubmit("alpha", 'b', /*ranked=*/false);
  PlayFirst(*practice, kLogHash);
  End(*practice, EvaluationState::kDone);
  EXPECT_TRUE(LogMayGo(kLogHash));
  Accepted rerun;
  ASSERT_TRUE(Write([&](Transaction& writer) -> absl::Status {
                auto added = writer.evaluations.Add(
                    {.submission = practice->submission, .kind = EvaluationKind::kRerun,
                     .grader_json = "{}"}, {{0, 1}}, "d");
                if (added.ok()) rerun = *added;
                return added.status();
              }).ok());
  EXPECT_FALSE(MayGo('b'));
  EXPECT_TRUE(LogMayGo(kLogHash)) << "it has not been played yet";
  PlayFirst(rerun, kLogHash);
  EXPECT_FALSE(LogMayGo(kLogHash));
  End(rerun, EvaluationState::kCancelled);
  EXPECT_TRUE(LogMayGo(kLogHash));
  EXPECT_TRUE(MayGo('b'));
}

TEST_F(RemovalTest, FactsThatCantBeReadKeepTheLogsThatTheyName) {
  const Accepted accepted = Submit("alpha", 'a');
  PlayFirst(accepted, kLogHash);
  ASSERT_TRUE(Record(accepted, 1, 1, FactsWith(kOtherLog)).ok());
  ASSERT_EQ(SqlError("DROP TRIGGER episode_fixed"), "");
  ASSERT_EQ(SqlError("UPDATE episode SET facts_json = substr(facts_json, 3) WHERE idx = 0"), "");
  EXPECT_FALSE(LogMayGo(kLogHash));
  EXPECT_FALSE(LogMayGo(kOtherLog));
  EXPECT_TRUE(LogMayGo(std::string(64, '3')));
  End(accepted, EvaluationState::kFailed);
  EXPECT_TRUE(LogMayGo(kLogHash));
}

// If the state is unreadable, the files stay.
TEST_F(RemovalTest, AStateThatCantBeReadKeepsTheFiles) {
  const absl::StatusOr<Accepted> practice = TrySubmit("alpha", 'b', /*ranked=*/true);
  PlayFirst(*practice, kLogHash);
  End(*practice, EvaluationState::kFailed);
  ASSERT_EQ(SqlError("DROP TRIGGER evaluation_final; PRAGMA ignore_check_constraints = ON; "
                     "UPDATE evaluation SET state = 'asleep'"), "");
  EXPECT_FALSE(MayGo('b'));
  EXPECT_FALSE(LogMayGo(kLogHash));
}

}  // namespace
}  // namespace myograde::server
