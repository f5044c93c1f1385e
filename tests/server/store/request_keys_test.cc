// Requests that are sent again with the same key are accepted once.
#include <functional>
#include <string>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/error_code.h"
#include "store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

const std::string kBody(64, 'b');
const std::string kOtherBody(64, 'c');

class RequestKeys : public StoreTest {
 protected:
  // Asks with this key; what is new becomes a practice submission.
  absl::StatusOr<Accepted> Ask(const std::string& who, const std::string& key,
                               const std::string& request = kBody) {
    Accepted accepted;
    const absl::Status status = store_->Write([&](Transaction& writer) {
      auto result = writer.submissions.Once(who, {key, request}, [&] { return AcceptOne(writer); });
      if (result.ok()) accepted = *result;
      return result.status();
    });
    if (!status.ok()) return status;
    return accepted;
  }

  absl::StatusOr<Accepted> AcceptOne(Transaction& writer) {
    const std::string hash(64, 'a');
    auto added = writer.content.AddArtefact({{"walker", {"./policy"}}, hash, 10, 2});
    if (!added.ok()) return added.status();
    NewSubmission submission;
    submission.team = "alpha";
    submission.artefact = hash;
    submission.track = "manipulation";
    submission.profile = "paper";
    submission.config = std::string(64, 'c');
    submission.config_json = submission.grader_json = "{}";
    submission.seeds = std::string(64, 'd');
    submission.seeds_json = "[1,2]";
    submission.blocks = {{0, 1}};
    AdmissionRules rules = kRules;
    rules.quota.waiting = 100'000;
    rules.quota.practice = {100'000, 100'000};
    return writer.submissions.Accept(submission, rules, "uid 1000");
  }

  int64_t Count(const std::string& sql) {
    SQLite::Database db(path_, SQLite::OPEN_READONLY);
    return db.execAndGet(sql).getInt64();
  }
};

TEST_F(RequestKeys, TheSameRequestIsAcceptedOnce) {
  const auto first = Ask("uid 1000", "k");
  const auto again = Ask("uid 1000", "k");
  ASSERT_TRUE(first.ok() && again.ok()) << first.status() << again.status();
  EXPECT_TRUE(first->is_new());
  EXPECT_TRUE(again->repeated);
  EXPECT_FALSE(again->linked);
  EXPECT_EQ(again->submission, first->submission);
  EXPECT_EQ(again->evaluation, first->evaluation);
  EXPECT_TRUE(again->blocks.empty());
  EXPECT_EQ(Count("SELECT count(*) FROM submission"), 1);
  Read([&](const Transaction& reader) {
    EXPECT_EQ((*reader.submissions.FindRequest("uid 1000", {"k", kBody}))->submission,
              first->submission);
    EXPECT_FALSE(reader.submissions.FindRequest("uid 1000", {"other", kBody})->has_value());
    EXPECT_FALSE(reader.submissions.FindRequest("uid 1000", {"", kBody})->has_value());
  });
}

TEST_F(RequestKeys, AnotherCallersKeyAndNoKeyAreNotTheSame) {
  ASSERT_TRUE(Ask("uid 1000", "k").ok());
  EXPECT_TRUE(Ask("uid 1001", "k")->is_new());
  EXPECT_TRUE(Ask("uid 1000", "")->is_new());
  EXPECT_TRUE(Ask("uid 1000", "")->is_new());
  EXPECT_EQ(Count("SELECT count(*) FROM request_key"), 2);
}

TEST_F(RequestKeys, AnotherRequestWithTheKeyIsRefused) {
  ASSERT_TRUE(Ask("uid 1000", "k").ok());
  const auto other = Ask("uid 1000", "k", kOtherBody);
  EXPECT_EQ(ErrorCodeOf(other.status()), kKeyReusedCode);
  EXPECT_THAT(std::string(other.status().message()), HasSubstr("for submission 1"));
  EXPECT_EQ(Count("SELECT count(*) FROM submission"), 1);
}

TEST_F(RequestKeys, ARefusedRequestKeepsNoKey) {
  const absl::Status status = store_->Write([&](Transaction& writer) {
    return writer
        .submissions.Once("uid 1000", {"k", kBody},
              []() -> absl::StatusOr<Accepted> { return absl::NotFoundError("no artefact"); })
        .status();
  });
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_TRUE(Ask("uid 1000", "k", kOtherBody)->is_new());
}

TEST_F(RequestKeys, OfTwoInOneTransactionOneIsAccepted) {
  int64_t submissions[2] = {};
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    absl::Status status;
    for (int64_t& submission : submissions) {
      status.Update(writer.Part([&](Transaction& part) {
        auto accepted =
            part.submissions.Once("uid 1000", {"k", kBody}, [&] { return AcceptOne(part); });
        if (accepted.ok()) submission = accepted->submission;
        return accepted.status();
      }));
    }
    return status;
  }).ok());
  EXPECT_EQ(submissions[0], submissions[1]);
  EXPECT_EQ(Count("SELECT count(*) FROM submission"), 1);
}

TEST_F(RequestKeys, AreKeptForADay) {
  const auto first = Ask("uid 1000", "k");
  clock_.Advance(kKeyAge);
  ASSERT_TRUE(Ask("uid 1001", "of another").ok());
  EXPECT_EQ(Ask("uid 1000", "k")->submission, first->submission);
  clock_.Advance(absl::Milliseconds(1));
  ASSERT_TRUE(Ask("uid 1001", "of another, later").ok());
  EXPECT_TRUE(Ask("uid 1000", "k")->is_new());
}

TEST_F(RequestKeys, OfOneCallerTheNewestAreKept) {
  ASSERT_TRUE(Ask("uid 1001", "of another").ok());
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    const auto accepted = AcceptOne(writer);
    absl::Status status = accepted.status();
    for (int64_t i = 0; i < kKeysOfOne; ++i) {
      status.Update(writer.submissions
                        .Once("uid 1000", {absl::StrCat("k", i), kBody}, [&] { return accepted; })
                        .status());
    }
    return status;
  }).ok());
  EXPECT_EQ(Count("SELECT count(*) FROM request_key WHERE who = 'uid 1000'"), kKeysOfOne);
  clock_.Advance(absl::Seconds(1));
  ASSERT_TRUE(Ask("uid 1000", "one more").ok());
  EXPECT_EQ(Count("SELECT count(*) FROM request_key WHERE who = 'uid 1000'"), kKeysOfOne);
  EXPECT_TRUE(Ask("uid 1000", "one more")->repeated);
  EXPECT_TRUE(Ask("uid 1001", "of another")->repeated);
}

TEST_F(RequestKeys, ADamagedRowIsReported) {
  ASSERT_TRUE(Ask("uid 1000", "k").ok());
  ASSERT_EQ(SqlError("PRAGMA ignore_check_constraints = ON; UPDATE request_key SET linked = 7"), "");
  const auto again = Ask("uid 1000", "k");
  EXPECT_EQ(ErrorCodeOf(again.status()), kDamagedRowCode) << again.status();
  EXPECT_EQ(Count("SELECT count(*) FROM submission"), 1);
}

}  // namespace
}  // namespace myograde::server
