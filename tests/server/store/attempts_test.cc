// Where attempts ran and what they used, and which nodes get no blocks.
#include "server/store/rows.h"

#include <limits>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class AttemptsTest : public StoreTest {
 protected:
  absl::Status Add(const AttemptRow& run) {
    return store_->Write([&](Transaction& writer) { return writer.blocks.RecordAttempt(run); });
  }
  void Drain(const std::string& node, const std::string& why) {
    const absl::Status status = store_->Write(
        [&](Transaction& writer) { return writer.blocks.SetNode(node, true, why, "uid 0"); });
    ASSERT_TRUE(status.ok()) << status;
  }
  void Admit(const std::string& node) {
    const absl::Status status = store_->Write(
        [&](Transaction& writer) { return writer.blocks.SetNode(node, false, "", "uid 7"); });
    ASSERT_TRUE(status.ok()) << status;
  }
  std::vector<AttemptRow> ListAttempts(int64_t evaluation) {
    std::vector<AttemptRow> runs;
    Read([&](const Transaction& reader) { runs = reader.blocks.ListAttempts(evaluation).value(); });
    return runs;
  }
  std::vector<std::string> Drained() {
    std::vector<std::string> nodes;
    Read([&](const Transaction& reader) {
      const Listed<DrainedNodeRow> drained = reader.blocks.DrainedNodes();
      EXPECT_THAT(drained.damaged, testing::IsEmpty());
      for (const DrainedNodeRow& node : drained.rows) {
        nodes.push_back(absl::StrCat(node.node, ": ", node.why, " (", node.who, ")"));
      }
    });
    return nodes;
  }
  int64_t Events() {
    return SQLite::Database(path_).execAndGet("SELECT count(*) FROM node_event").getInt64();
  }
};

TEST_F(AttemptsTest, AnAttemptIsReadAsItWasRecorded) {
  const Accepted accepted = Submit();
  const Accepted other = Submit("beta", 'b');
  ASSERT_TRUE(Add({accepted.blocks[1], 2, "n7", "12_3", 1000, 9000, 7.25, 1234.5, RunEnd::kDone}).ok());
  ASSERT_TRUE(Add({accepted.blocks[1], 1, "n6", "12_2", 0, 500, 0, std::nullopt,
                   RunEnd::kReturned}).ok());
  ASSERT_TRUE(Add({other.blocks[0], 1, "", "", 1, 2, 1, std::nullopt, RunEnd::kFault}).ok());
  const std::vector<AttemptRow> runs = ListAttempts(accepted.evaluation);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].attempt, 1);
  EXPECT_EQ(runs[0].began_at, 0) << "it never began";
  EXPECT_EQ(runs[0].energy_j, std::nullopt);
  EXPECT_EQ(runs[0].how, RunEnd::kReturned);
  EXPECT_EQ(runs[1].block, accepted.blocks[1]);
  EXPECT_EQ(runs[1].attempt, 2);
  EXPECT_EQ(runs[1].node, "n7");
  EXPECT_EQ(runs[1].job, "12_3");
  EXPECT_EQ(runs[1].began_at, 1000);
  EXPECT_EQ(runs[1].ended_at, 9000);
  EXPECT_EQ(runs[1].cpu_s, 7.25);
  EXPECT_EQ(runs[1].energy_j, 1234.5);
  EXPECT_EQ(runs[1].how, RunEnd::kDone);
}

TEST_F(AttemptsTest, WhatIsThereStaysWhenItIsRecordedAgain) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Add({accepted.blocks[0], 1, "n1", "5", 1, 2, 3, std::nullopt, RunEnd::kDone}).ok());
  ASSERT_TRUE(Add({accepted.blocks[0], 1, "n2", "6", 3, 4, 5, 6.0, RunEnd::kFault}).ok());
  const std::vector<AttemptRow> runs = ListAttempts(accepted.evaluation);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].node, "n1");
  EXPECT_THAT(SqlError("UPDATE attempt SET node = 'n3'"), HasSubstr("never changed"));
  EXPECT_THAT(SqlError("DELETE FROM attempt"), HasSubstr("never deleted"));
}

TEST_F(AttemptsTest, AMeasurementThatNoAttemptCanHaveDoesNotKeepItFromTheStore) {
  const Accepted accepted = Submit();
  const double infinity = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(Add({accepted.blocks[0], 1, "n", "", 1, 2, nan, infinity, RunEnd::kDone}).ok());
  ASSERT_TRUE(Add({accepted.blocks[0], 2, "n", "", 1, 2, -5, -infinity, RunEnd::kDone}).ok());
  const std::vector<AttemptRow> runs = ListAttempts(accepted.evaluation);
  EXPECT_EQ(runs[0].cpu_s, 0);
  EXPECT_EQ(runs[0].energy_j, 1e12);
  EXPECT_EQ(runs[1].cpu_s, 0);
  EXPECT_EQ(runs[1].energy_j, 0.0);
}

TEST_F(AttemptsTest, TheTimeOfTheEndIsNowUnlessItIsGiven) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Add({.block = accepted.blocks[0], .attempt = 1}).ok());
  const AttemptRow run = ListAttempts(accepted.evaluation).at(0);
  EXPECT_GT(run.ended_at, 0);
  EXPECT_EQ(run.began_at, 0);
}

TEST_F(AttemptsTest, ABlockThatThereIsNotHasNoAttempts) {
  EXPECT_EQ(Add({.block = 77, .attempt = 1}).code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(AttemptsTest, ADamagedRowIsToldByItsBlock) {
  const Accepted accepted = Submit();
  ASSERT_TRUE(Add({.block = accepted.blocks[0], .attempt = 1}).ok());
  ASSERT_EQ(SqlError("PRAGMA ignore_check_constraints = ON; DROP TRIGGER attempt_fixed; "
                     "UPDATE attempt SET how = 'lost'"), "");
  Read([&](const Transaction& reader) {
    const auto runs = reader.blocks.ListAttempts(accepted.evaluation);
    ASSERT_FALSE(runs.ok());
    EXPECT_THAT(std::string(runs.status().message()), HasSubstr("attempt"));
    EXPECT_THAT(std::string(runs.status().message()), HasSubstr("\"how\""));
  });
}

TEST_F(AttemptsTest, ANodeIsDrainedUntilItIsAdmitted) {
  Drain("n2", "its proof differs");
  Drain("n1", "a fan is broken");
  EXPECT_THAT(Drained(), ElementsAre("n1: a fan is broken (uid 0)", "n2: its proof differs (uid 0)"));
  Admit("n1");
  EXPECT_THAT(Drained(), ElementsAre("n2: its proof differs (uid 0)"));
  Drain("n1", "again");
  EXPECT_THAT(Drained(), ElementsAre("n1: again (uid 0)", "n2: its proof differs (uid 0)"));
  EXPECT_EQ(Events(), 4);
}

TEST_F(AttemptsTest, WhatChangesNothingAddsNoEvent) {
  Admit("n1");
  EXPECT_EQ(Events(), 0) << "it was not drained";
  Drain("n1", "a fan is broken");
  Drain("n1", "a fan is broken");
  EXPECT_EQ(Events(), 1);
  Drain("n1", "two fans are broken");
  EXPECT_THAT(Drained(), ElementsAre("n1: two fans are broken (uid 0)"));
  Admit("n1");
  Admit("n1");
  EXPECT_EQ(Events(), 3);
  EXPECT_THAT(SqlError("DELETE FROM node_event"), HasSubstr("never deleted"));
  EXPECT_THAT(SqlError("UPDATE node_event SET node = 'n3'"), HasSubstr("never changed"));
}

}  // namespace
}  // namespace myograde::server
