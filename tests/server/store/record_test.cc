// The public record: one entry with each change, and a chain over all.
#include <map>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "store_fixture.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class RecordTest : public StoreTest {
 protected:
  std::vector<RecordRow> Rows() {
    std::vector<RecordRow> rows;
    Read([&](const Transaction& reader) {
      EXPECT_EQ(reader.journal.RecordSize(), std::ssize(reader.journal.Record(0, 1000).rows));
      rows = reader.journal.Record(0, 1000).rows;
    });
    return rows;
  }

  std::vector<Json> Entries() {
    std::vector<Json> entries;
    for (const RecordRow& row : Rows()) entries.push_back(Json::parse(row.entry_json));
    return entries;
  }

  std::vector<std::string> Kinds() {
    std::vector<std::string> kinds;
    for (const Json& entry : Entries()) kinds.push_back(entry["kind"]);
    return kinds;
  }

  void ExpectChain() {
    std::string chain;
    for (const RecordRow& row : Rows()) {
      chain = ExtendChain(chain, row.entry_json);
      EXPECT_EQ(row.chain, chain) << row.index;
    }
  }

  void Play(const Accepted& accepted, EvaluationState state = EvaluationState::kDone) {
    for (size_t i = 0; i < accepted.blocks.size(); ++i) {
      ASSERT_TRUE(Start(accepted.blocks[i], 1).ok());
      for (const int64_t index : {2 * i, 2 * i + 1}) {
        ASSERT_TRUE(Record(accepted, index, 1).ok());
      }
      ASSERT_TRUE(store_->Write([&](Transaction& writer) {
        return writer.blocks.Finish(accepted.blocks[i], 1, "{}", "daemon");
      }).ok());
    }
    const absl::Status ended = store_->Write([&](Transaction& writer) {
      return writer.evaluations.End(accepted.evaluation, state, "", std::string(64, 'e'), "daemon");
    });
    ASSERT_TRUE(ended.ok()) << ended;
  }

  void Mark(int64_t submission, const std::string& mark, bool set, const std::string& why) {
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      return writer.journal.Mark(submission, mark, set, "uid 0", why).status();
    }).ok());
  }
};

TEST_F(RecordTest, EachChangeAddsItsEntryInItsTransaction) {
  const Accepted accepted = Submit("alpha");
  Play(accepted);
  Mark(accepted.submission, "hidden", true, "a private reason");
  Mark(accepted.submission, "disqualified", true, "reads the seeds");
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    absl::Status status = writer.journal.Choose(accepted.submission, "uid 0").status();
    status.Update(writer.phases.EnsureSecret("final").status());
    status.Update(writer.phases.AddEvent("final", kPausedEvent, "uid 0", "why").status());
    status.Update(writer.phases.AddEvent("final", kRevealedEvent, "uid 0", "why").status());
    status.Update(writer.teams.Rename("alpha", "beta", "uid 0", "asked").status());
    status.Update(writer.teams.Ban("beta", true, "uid 0", "cheats").status());
    return status;
  }).ok());
  EXPECT_THAT(Kinds(), ElementsAre("team", "accepted", "graded", "marked", "marked", "chosen",
                                   "commitment", "phase", "phase", "team", "team"));
  ExpectChain();
  const std::vector<Json> entries = Entries();
  EXPECT_EQ(entries[1]["artefact"], ArtefactCommitment(accepted.submission, std::string(64, 'a')));
  EXPECT_EQ(entries[2]["results"], std::string(64, 'e'));
  EXPECT_EQ(entries[2]["state"], "graded");
  EXPECT_EQ(entries[8]["secret"].get<std::string>().size(), 64u);
  EXPECT_EQ(entries[9]["team"], "beta");
  std::string all;
  for (const Json& entry : entries) all += entry.dump();
  for (const char* hidden : {"a private reason", "cheats", "uid 0", "success", "[1,2,3,4]"}) {
    EXPECT_THAT(all, testing::Not(HasSubstr(hidden)));
  }
  EXPECT_THAT(all, testing::Not(HasSubstr(std::string(64, 'a')))) << "the artefact's hash";
  EXPECT_THAT(all, HasSubstr("reads the seeds"));
}

TEST_F(RecordTest, AMarkOfPracticeIsKeptButNotPublic) {
  const absl::StatusOr<Accepted> practice = TrySubmit("alpha", 'a', /*ranked=*/false);
  ASSERT_TRUE(practice.ok()) << practice.status();
  const size_t before = Rows().size();
  Mark(practice->submission, "hidden", true, "wrong file");
  EXPECT_EQ(Rows().size(), before);
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.Board().MarkHistory(practice->submission).size(), 1u);
  });
}

TEST_F(RecordTest, AFailedChangeLeavesNoEntry) {
  const size_t before = Rows().size();
  EXPECT_FALSE(store_->Write([&](Transaction& writer) -> absl::Status {
    EXPECT_TRUE(writer.teams.Create("alpha", "uid 0", "").ok());
    return absl::CancelledError("no");
  }).ok());
  EXPECT_EQ(Rows().size(), before);
}

TEST_F(RecordTest, PracticeIsNotPublicAndFailedOnesLookLikeDoneOnes) {
  ASSERT_TRUE(TrySubmit("alpha", 'a', /*ranked=*/false).ok());
  EXPECT_THAT(Kinds(), ElementsAre("team"));
  Play(Submit("alpha", 'b'), EvaluationState::kFailed);
  EXPECT_EQ(Entries().back()["state"], "graded");
}

TEST_F(RecordTest, ABrokenLastEntryIsGoneOnFrom) {
  Submit("alpha");
  EXPECT_EQ(SqlError("DROP TRIGGER journal_fixed; UPDATE journal SET chain = printf('%064d', 1) "
                     "WHERE entry = 1"), "");
  Submit("beta", 'b');
  const std::vector<RecordRow> rows = Rows();
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_EQ(rows[2].chain, ExtendChain(rows[1].chain, rows[2].entry_json));
}

TEST_F(RecordTest, NobodyChangesOrRemovesAnEntry) {
  Submit("alpha");
  EXPECT_THAT(SqlError("UPDATE journal SET entry_json = '{}'"), HasSubstr("never changed"));
  EXPECT_THAT(SqlError("DELETE FROM journal"), HasSubstr("never deleted"));
  EXPECT_THAT(SqlError("INSERT INTO journal SELECT 99, at, kind, who, evaluation, private_json, 7, "
                       "entry_json, chain FROM journal WHERE entry = 1"),
              HasSubstr("0, 1, 2 and so on"));
}

TEST_F(RecordTest, TheSigningKeyIsNamedWhenItIsNew) {
  for (const char* key : {"one", "one", "two"}) {
    ASSERT_TRUE(
        store_->Write([&](Transaction& writer) { return writer.journal.AppendKey(key); }).ok());
  }
  EXPECT_THAT(Kinds(), ElementsAre("key", "key"));
  EXPECT_EQ(Entries().back()["key"], "two");
}

TEST_F(RecordTest, AnEvaluationsEntryIsFound) {
  const Accepted accepted = Submit("alpha");
  Read([&](const Transaction& reader) {
    EXPECT_TRUE(absl::IsNotFound(reader.journal.GradedEntry(accepted.evaluation).status()));
  });
  Play(accepted);
  Read([&](const Transaction& reader) {
    const absl::StatusOr<RecordRow> row = reader.journal.GradedEntry(accepted.evaluation);
    ASSERT_TRUE(row.ok()) << row.status();
    EXPECT_EQ(row->index, 2);
  });
}

}  // namespace
}  // namespace myograde::server
