// What is left of answers whose reader may not see everything.
#include "server/api/redaction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/api/views.h"

namespace myograde::server {
namespace {

using testing::Not;

Json Counts() {
  return {{"total", 3}, {"done", 2}, {"success", 1}, {"failure", 1}, {"fault", 0}};
}

Json Row() {
  return {{"index", 0},
          {"seed", 7},
          {"seed_commitment", "c"},
          {"outcome", "crash"},
          {"reason", "time"},
          {"metrics", {{"success", 1}, {"time_s", 0.5}}},
          {"steps", 100},
          {"sim_time_s", 1.0},
          {"clipped", 0},
          {"digest", "d"},
          {"actions_digest", "a"},
          {"log", {{"sha256", "l"}}},
          {"end", "fault"},
          {"fault",
           {{"outcome", "crash"},
            {"whose", "participant"},
            {"limit", ""},
            {"limit_value", 0},
            {"value", 139},
            {"step", 7},
            {"detail", "died"},
            {"stderr_tail", "secret words"}}},
          {"facts", {{"frames", 3}}},
          {"details", {{"fall_time", 1.5}}},
          {"wall_s", 0.1},
          {"policy_cpu_s", 0.2},
          {"attempt", 1}};
}

Json Evaluation(const std::string& state = "done") {
  return {{"submission", 7},
          {"team", "alpha"},
          {"state", state},
          {"episodes", Counts()},
          {"outcomes", {{"success", 1}}},
          {"reasons", {{"time", 1}}},
          {"aggregate", {{"time_s", 0.5}}},
          {"hashes", {{"results", "r"}}},
          {"merkle_root", "m"},
          {"reason", "the grader wrote words"},
          {"output", {{{"stdout_tail", "secret words"}}}},
          {"not_repeatable", {{{"index", 0}, {"differs", {"digest"}}}}},
          {"comparison",
           {{"with", 1},
            {"compared", 1},
            {"equal", 0},
            {"missing", 0},
            {"episodes", {{{"index", 0}, {"equal", false}, {"original", {{"steps", 100}}}}}}}},
          {"episode_rows", {Row()}}};
}

Json Redacted(Json answer, const Visibility& visibility) {
  RedactEvaluation(answer, visibility);
  return answer;
}

TEST(RedactEvaluation, LeavesEverythingToThoseWhoMaySeeIt) {
  EXPECT_EQ(Redacted(Evaluation(), {}), Evaluation());
}

TEST(RedactEvaluation, HidesSeedsAndNothingElse) {
  const Json answer = Redacted(Evaluation(), {.seeds = false});
  Json expected = Evaluation();
  expected["episode_rows"][0]["seed"] = nullptr;
  expected["withheld"] = {"seeds"};
  EXPECT_EQ(answer, expected);
}

TEST(RedactEvaluation, HidesEachPartByItsName) {
  Json answer = Redacted(Evaluation(), {.outcomes = false});
  Json row = answer["episode_rows"][0];
  for (const char* key : {"outcome", "reason", "end", "fault"}) {
    EXPECT_TRUE(row[key].is_null()) << key;
  }
  EXPECT_EQ(row["metrics"], Json({{"success", nullptr}, {"time_s", 0.5}}));
  EXPECT_EQ(answer["outcomes"], Json::object());
  EXPECT_EQ(answer["comparison"]["episodes"], Json::array());
  EXPECT_TRUE(answer["comparison"]["equal"].is_null());

  answer = Redacted(Evaluation(), {.metrics = false});
  row = answer["episode_rows"][0];
  for (const char* key : {"steps", "sim_time_s", "clipped", "digest", "actions_digest", "wall_s",
                          "policy_cpu_s"}) {
    EXPECT_TRUE(row[key].is_null()) << key;
  }
  EXPECT_EQ(row["metrics"], Json::object());
  EXPECT_TRUE(row["fault"]["step"].is_null());
  EXPECT_EQ(row["fault"]["outcome"], "crash");
  EXPECT_EQ(row["outcome"], "crash");

  answer = Redacted(Evaluation(), {.logs = false});
  EXPECT_TRUE(answer["episode_rows"][0]["log"].is_null());
  EXPECT_TRUE(answer["episode_rows"][0]["facts"].is_null());
  EXPECT_TRUE(answer["episode_rows"][0]["details"].is_null());

  answer = Redacted(Evaluation(), {.output = false});
  EXPECT_EQ(answer["output"], Json::array());
  EXPECT_EQ(answer.dump().find("secret words"), std::string::npos);
  EXPECT_TRUE(answer["episode_rows"][0]["fault"]["detail"].is_null());

  answer = Redacted(Evaluation(), {.aggregate = false, .outcomes = false});
  EXPECT_TRUE(answer["aggregate"].is_null());
  EXPECT_TRUE(answer["episodes"]["success"].is_null());
  EXPECT_EQ(answer["episodes"]["done"], 2);
  EXPECT_EQ(answer["hashes"]["results"], "r");
  EXPECT_EQ(answer["merkle_root"], "m");
}

// Whoever polls would otherwise see from each change how one more episode ended.
TEST(RedactEvaluation, NumbersOfAPartAreHiddenWhileEpisodesAre) {
  const Visibility visibility = {.outcomes = false, .metrics = false};
  EXPECT_FALSE(Redacted(Evaluation("done"), visibility)["aggregate"].is_null());
  EXPECT_EQ(Redacted(Evaluation("done"), visibility)["episodes"]["success"], 1);
  for (const char* state : {"queued", "running", "cancelled", "grader_error"}) {
    const Json answer = Redacted(Evaluation(state), visibility);
    EXPECT_TRUE(answer["aggregate"].is_null()) << state;
    for (const char* key : {"success", "failure", "fault"}) {
      EXPECT_TRUE(answer["episodes"][key].is_null()) << state;
    }
  }
  EXPECT_FALSE(Redacted(Evaluation("running"), {.logs = false})["aggregate"].is_null());
}

TEST(RedactEvaluation, QuotesOfTheGraderNeedTheOutput) {
  const Visibility visibility = {.output = false};
  EXPECT_FALSE(Redacted(Evaluation("cancelled"), visibility)["reason"].is_null());
  EXPECT_TRUE(Redacted(Evaluation("grader_error"), visibility)["reason"].is_null());
}

TEST(RedactEvaluation, WithholdsWhatItDoesNotKnow) {
  Json answer = Evaluation();
  answer["new_key"] = 7;
  answer["episode_rows"][0]["new_key"] = 7;
  const Json seen = Redacted(answer, {.logs = false});
  EXPECT_TRUE(seen["new_key"].is_null());
  EXPECT_TRUE(seen["episode_rows"][0]["new_key"].is_null());
  EXPECT_EQ(Redacted(answer, {}), answer);
}

TEST(RedactStatus, HidesWhereABlockIsAndWhatWentWrong) {
  Json status = {{"state", "grader_error"},
                 {"episodes", Counts()},
                 {"reason", "words"},
                 {"history", {{{"to", "grader_error"}, {"why", "words"}}}},
                 {"blocks", {{{"block", 1}, {"episode", 3}, {"step", 9}, {"detail", "words"}}}}};
  RedactStatus(status, {.outcomes = false, .metrics = false, .output = false, .progress = false});
  EXPECT_EQ(status.dump().find("words"), std::string::npos);
  EXPECT_TRUE(status["blocks"][0]["episode"].is_null());
  EXPECT_TRUE(status["blocks"][0]["step"].is_null());
  EXPECT_EQ(status["blocks"][0]["block"], 1);
  EXPECT_EQ(status["withheld"], Json({"outcomes", "metrics", "output"}));
}

TEST(RedactStatus, ShowsNoProgressInsideABlockWhereAnythingIsWithheld) {
  Json status = {{"state", "running"},
                 {"episodes", {{"total", 4}, {"done", 2}}},
                 {"blocks", {{{"block", 1}, {"episode", 3}, {"step", 9}, {"silent_wall_s", 0.1}}}}};
  RedactStatus(status, {.seeds = false, .progress = false});
  for (const char* key : {"episode", "step", "silent_wall_s"}) {
    EXPECT_TRUE(status["blocks"][0][key].is_null()) << key;
  }
}

// Nobody knows of one that runs whether it will be charged.
TEST(RedactEvaluation, OneThatIsNotDoneTellsOneReasonWhereAnythingIsWithheld) {
  for (const char* state : {"failed", "running", "grader_error"}) {
    Json answer = {{"state", state},
                   {"reason", "every episode ended so, the first as crash"},
                   {"episodes", {{"total", 2}, {"done", 2}, {"fault", 2}}},
                   {"outcomes", {{"crash", 1}, {"protocol", 1}}},
                   {"aggregate", {{"time_s", 10.0}}},
                   {"output", {{{"block", 1}, {"stderr_tail", "a"}}, {{"block", 2}, {"stderr_tail", "b"}}}},
                   {"episode_rows", {{{"index", 0}, {"outcome", "crash"}, {"steps", 5},
                                      {"fault", {{"outcome", "crash"}, {"detail", "x"}}}}}}};
    Json all = answer;
    RedactEvaluation(all, {});
    EXPECT_EQ(all, answer);
    RedactEvaluation(answer, {.seeds = false, .progress = false});
    EXPECT_EQ(answer["reason"], "every episode ended so, the first as crash");
    EXPECT_EQ(answer["outcomes"], Json::object());
    EXPECT_TRUE(answer["aggregate"].is_null());
    EXPECT_TRUE(answer["episodes"]["fault"].is_null());
    EXPECT_EQ(answer["episodes"]["done"], 2);
    EXPECT_EQ(answer["output"].size(), 1u);
    for (const char* key : {"outcome", "steps", "fault"}) {
      EXPECT_TRUE(answer["episode_rows"][0][key].is_null()) << state << ' ' << key;
    }
    Json status = {{"state", state},
                   {"episodes", Counts()},
                   {"blocks", {{{"block", 1}, {"attempts", {{{"cpu_s", 1.5}}}}}}}};
    RedactStatus(status, {.seeds = false, .progress = false});
    EXPECT_EQ(status["blocks"][0]["attempts"], Json::array());
  }
}

TEST(RedactLedgerRow, HidesHowAnEpisodeEnded) {
  const Json charge = {{"entry", "charge"}, {"why", "episode 0 ended as failure"}};
  Json row = charge;
  RedactLedgerRow(row, {.logs = false, .seeds = false});
  EXPECT_EQ(row, charge);
  RedactLedgerRow(row, {.outcomes = false});
  EXPECT_EQ(row.dump().find("failure"), std::string::npos);
}

TEST(RedactListed, HidesCountsAndKeepsTheRest) {
  Json entry = {{"submission", 7}, {"state", "running"}, {"episodes", Counts()}};
  RedactListed(entry, {.outcomes = false});
  EXPECT_TRUE(entry["episodes"]["success"].is_null());
  EXPECT_EQ(entry["submission"], 7);
}

}  // namespace
}  // namespace myograde::server
