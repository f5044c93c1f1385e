// What webhooks are told is written with what it tells of, or not at all.
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Json = nlohmann::json;

class DeliveriesTest : public StoreTest {
 protected:
  void SetUp() override {
    StoreTest::SetUp();
    store_->SetWebhooks(
        {{.name = "all", .events = {std::begin(kWebhookEvents), std::end(kWebhookEvents)}},
         {.name = "pauses", .events = {kPauseEvent}}});
  }

  std::vector<DeliveryRow> Rows(const std::string& webhook) {
    std::vector<DeliveryRow> rows;
    Read([&](const Transaction& reader) {
      rows = reader.deliveries.List(webhook, INT64_MAX, 100).rows;
    });
    return rows;
  }
  std::vector<std::string> Events(const std::string& webhook) {
    std::vector<std::string> events;
    for (const DeliveryRow& row : Rows(webhook)) events.push_back(row.event);
    return events;
  }
  absl::Status Cancel(const Accepted& accepted) {
    return store_->Write([&](Transaction& writer) {
      return writer.evaluations.EndWithBlocks(accepted.evaluation, EvaluationState::kCancelled, "",
                                              "uid 0");
    });
  }
  void Pause(const std::string& phase, const std::string& why) {
    const absl::Status status = store_->Write([&](Transaction& writer) {
      return writer.phases.AddEvent(phase, kPausedEvent, "uid 0", why).status();
    });
    ASSERT_TRUE(status.ok()) << status;
  }
};

TEST_F(DeliveriesTest, AnEndIsToldToWhomItConcerns) {
  const Accepted accepted = Submit("Team \"x\"");
  ASSERT_TRUE(Cancel(accepted).ok());
  ASSERT_TRUE(Cancel(accepted).ok()) << "a second time is the same";
  EXPECT_THAT(Events("all"), ElementsAre(kCancelledEvent));
  EXPECT_THAT(Events("pauses"), IsEmpty());
  const DeliveryRow row = Rows("all").front();
  Json body = Json::parse(row.body_json);
  EXPECT_EQ(body["id"].get<std::string>().size(), 32u);
  body.erase("id");
  body.erase("at");
  EXPECT_EQ(body, Json({{"event", kCancelledEvent},
                        {"submission", accepted.submission},
                        {"evaluation", accepted.evaluation},
                        {"state", "cancelled"},
                        {"team", "Team \"x\""},
                        {"track", "manipulation"},
                        {"profile", "paper"},
                        {"phase", nullptr},
                        {"ranked", true}}));
}

TEST_F(DeliveriesTest, WhatIsRolledBackIsNotTold) {
  const Accepted accepted = Submit();
  const absl::Status status = store_->Write([&](Transaction& writer) {
    EXPECT_TRUE(writer.evaluations
                    .EndWithBlocks(accepted.evaluation, EvaluationState::kCancelled, "", "uid 0")
                    .ok());
    return absl::AbortedError("no");
  });
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(Events("all"), IsEmpty());
}

TEST_F(DeliveriesTest, ARerunIsToldToNobody) {
  const Accepted accepted = Submit();
  Accepted rerun;
  ASSERT_TRUE(store_
                  ->Write([&](Transaction& writer) {
                    auto added = writer.evaluations.Add(
                        {.submission = accepted.submission, .kind = EvaluationKind::kRerun,
                         .grader_json = "{}"}, {{0, 1}}, "uid 0");
                    if (added.ok()) rerun = *added;
                    return added.status();
                  })
                  .ok());
  ASSERT_TRUE(Cancel(rerun).ok());
  EXPECT_THAT(Events("all"), IsEmpty());
}

TEST_F(DeliveriesTest, AnEvaluationEndsAlsoIfNobodyCanBeTold) {
  const Accepted accepted = Submit();
  ASSERT_EQ(SqlError("CREATE TRIGGER no BEFORE INSERT ON delivery BEGIN SELECT RAISE(ABORT, 'no'); "
                     "END"), "");
  EXPECT_TRUE(Cancel(accepted).ok());
  EXPECT_THAT(Events("all"), IsEmpty());
}

TEST_F(DeliveriesTest, ADamagedSubmissionIsToldByItsNumbers) {
  const Accepted accepted = Submit();
  ASSERT_EQ(SqlError("PRAGMA foreign_keys = OFF; UPDATE team SET name = CAST(x'ff' AS TEXT)"), "");
  (void)Cancel(accepted);
  const std::vector<DeliveryRow> rows = Rows("all");
  ASSERT_EQ(rows.size(), 1u);
  const Json body = Json::parse(rows.front().body_json);
  EXPECT_EQ(body["submission"], accepted.submission);
  EXPECT_FALSE(body.contains("team"));
}

TEST_F(DeliveriesTest, TheOldestWaitsFirstAndOutcomesStay) {
  Pause("", "one");
  Pause("", "two");
  EXPECT_THAT(Events("pauses"), ElementsAre(kPauseEvent, kPauseEvent));
  absl::StatusOr<DeliveryRow> next = absl::NotFoundError("");
  Read([&](const Transaction& reader) { next = reader.deliveries.Next("pauses"); });
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(Json::parse(next->body_json)["reason"], "one");
  ASSERT_TRUE(store_
                  ->Write([&](Transaction& writer) {
                    return writer.deliveries.Set({.id = next->id,
                                                  .webhook = {},
                                                  .event = {},
                                                  .body_json = {},
                                                  .state = "delivered",
                                                  .attempts = 3,
                                                  .due_at = next->due_at,
                                                  .detail = {}});
                  })
                  .ok());
  Read([&](const Transaction& reader) { next = reader.deliveries.Next("pauses"); });
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(Json::parse(next->body_json)["reason"], "two");
  std::vector<DeliveryCounts> counts;
  Read([&](const Transaction& reader) { counts = reader.deliveries.Counts(); });
  ASSERT_EQ(counts.size(), 2u);
  EXPECT_EQ(counts[1].webhook, "pauses");
  EXPECT_EQ(counts[1].waiting, 1);
  EXPECT_EQ(counts[1].delivered, 1);
  EXPECT_GT(counts[1].oldest_waiting_at, 0);
}

TEST_F(DeliveriesTest, StrangersAreGivenUpAndOldRowsGo) {
  Pause("", "one");
  absl::StatusOr<int64_t> given_up = 0;
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    given_up = writer.deliveries.AbandonAllBut({"all"});
    return given_up.status();
  }).ok());
  EXPECT_EQ(*given_up, 1);
  EXPECT_EQ(Rows("pauses").front().state, "given_up");
  ASSERT_TRUE(
      store_->Write([](Transaction& writer) { return writer.deliveries.Prune(INT64_MAX); }).ok());
  EXPECT_THAT(Rows("pauses"), IsEmpty());
  EXPECT_EQ(Rows("all").size(), 1u) << "what waits stays";
}

TEST_F(DeliveriesTest, SubmissionsAreCountedByState) {
  Submit("alpha", 'a');
  ASSERT_TRUE(Cancel(Submit("beta", 'b')).ok());
  std::map<std::string, int64_t> counts;
  Read([&](const Transaction& reader) { counts = reader.submissions.CountByState(); });
  EXPECT_EQ(counts, (std::map<std::string, int64_t>{{"cancelled", 1}, {"queued", 1}}));
}

}  // namespace
}  // namespace myograde::server
