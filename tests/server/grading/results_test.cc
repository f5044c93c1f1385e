// From facts to rows and from rows to numbers: nothing is lost, and contradictions are not
// recorded.
#include "server/grading/results.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/lease.h"
#include "protocol/lease/seed_commitment.h"
#include "scoring/aggregate_json.h"
#include "scoring/locomotion/track.h"
#include "scoring/manipulation/track.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

TrackPtr LoadTrack(const std::string& name) {
  auto config = LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", name, "paper");
  if (!config.ok()) return nullptr;
  auto track = MakeTrack(*std::move(config));
  return track.ok() ? *track : nullptr;
}

EpisodeFacts Walked(int64_t index, double distance) {
  EpisodeFacts facts;
  facts.index = index;
  facts.seed = 18446744073709551615u;
  facts.end = LocomotionEnd::kFell;
  facts.steps = 10;
  facts.sim_time = 0.1;
  facts.digest = "d";
  LocomotionFacts walk;
  walk.distance = distance;
  walk.effort_sum = 5;
  walk.pain_sum = 2;
  facts.track = walk;
  return facts;
}

TEST(JudgedRow, HoldsTheFactsTheVerdictAndTheMetrics) {
  const TrackPtr track = LoadTrack("locomotion");
  ASSERT_NE(track, nullptr);
  const auto row = JudgedRow(*track, Walked(4, 12.5));
  ASSERT_TRUE(row.ok()) << row.status();
  EXPECT_EQ(row->index, 4);
  EXPECT_EQ(row->seed, 18446744073709551615u);
  EXPECT_EQ(row->outcome, Outcome::kFailure);
  EXPECT_EQ(row->reason, LocomotionReason::kFell);
  const auto facts = EpisodeFactsFromJson(nlohmann::json::parse(row->facts_json));
  ASSERT_TRUE(facts.ok()) << facts.status();
  EXPECT_EQ(std::get<LocomotionFacts>(facts->track).distance, 12.5);
  const auto verdict = ReadVerdict(*track->scoring.track, *row);
  ASSERT_TRUE(verdict.ok()) << verdict.status();
  EXPECT_EQ(verdict->metrics[scoring::LocomotionMetric::kDistance], 12.5);
  EXPECT_EQ(verdict->metrics[scoring::LocomotionMetric::kEffort], 0.5);
  EXPECT_EQ(verdict->metrics[scoring::LocomotionMetric::kPain], 0.2);
}

TEST(JudgedRow, HasTheDetailsBesideAndNothingFollowsFromThem) {
  const TrackPtr track = LoadTrack("locomotion");
  ASSERT_NE(track, nullptr);
  EpisodeFacts facts = Walked(4, 12.5);
  const auto without = JudgedRow(*track, facts);
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_EQ(without->details_json, "");
  LocomotionDetails details;
  details.fall_time = 3.5;
  facts.details = details;
  const auto with = JudgedRow(*track, facts);
  ASSERT_TRUE(with.ok()) << with.status();
  EXPECT_EQ(nlohmann::json::parse(with->details_json)["fall_time"], 3.5);
  EXPECT_EQ(with->facts_json, without->facts_json);
  EXPECT_EQ(with->metrics_json, without->metrics_json);
  EXPECT_EQ(ComputeMerkleRoot({*with}, ""), ComputeMerkleRoot({*without}, ""));
  EXPECT_EQ(ReceiptEntry(*with, ""), ReceiptEntry(*without, ""));
}

TEST(JudgedRow, AFaultWithoutAStepHasNoMeans) {
  const TrackPtr track = LoadTrack("locomotion");
  ASSERT_NE(track, nullptr);
  EpisodeFacts facts = Walked(0, 0);
  facts.end = EpisodeEnd::kFault;
  facts.fault.outcome = Outcome::kInitTimeout;
  facts.steps = 0;
  const auto row = JudgedRow(*track, facts);
  ASSERT_TRUE(row.ok()) << row.status();
  EXPECT_EQ(row->outcome, Outcome::kInitTimeout);
  const auto verdict = ReadVerdict(*track->scoring.track, *row);
  ASSERT_TRUE(verdict.ok()) << verdict.status();
  EXPECT_FALSE(verdict->metrics[scoring::LocomotionMetric::kEffort]);
  EXPECT_FALSE(verdict->metrics[scoring::LocomotionMetric::kPain]);
}

TEST(JudgedRow, RefusesWhatIsNoPlayedEpisodeOfTheTrack) {
  const TrackPtr track = LoadTrack("manipulation");
  ASSERT_NE(track, nullptr);
  EXPECT_THAT(JudgedRow(*track, Walked(2, 1)).status().message(),
              HasSubstr("episode 2 came with the facts of another track"));
  EpisodeFacts fault;
  fault.index = 3;
  fault.fault.outcome = Outcome::kGraderError;
  fault.fault.detail = "the model was gone";
  const auto row = JudgedRow(*track, fault);
  EXPECT_TRUE(absl::IsInternal(row.status()));
  EXPECT_THAT(row.status().message(), HasSubstr("episode 3: the model was gone"));
}

TEST(ReadVerdict, TellsARowThatCanNotBeRead) {
  const TrackPtr track = LoadTrack("manipulation");
  ASSERT_NE(track, nullptr);
  for (const char* text :
       {"", "{", "[]", "null", "{}", R"({"time_s": "1"})", R"({"time_s": null})"}) {
    EpisodeRow row;
    row.metrics_json = text;
    row.facts_json = R"({"steps": 1})";
    EXPECT_TRUE(ExtractDamage(ReadVerdict(*track->scoring.track, row).status())) << text;
    EXPECT_TRUE(ExtractDamage(AggregateRows(*track->scoring.track, {row}).status())) << text;
  }
  for (const char* text : {"", "{", "[]", "{}", R"({"steps": "1"})", R"({"steps": -1})",
                           R"({"steps": 1e300})", R"({"steps": 18446744073709551615})"}) {
    EpisodeRow row;
    row.metrics_json = R"({"time_s": 1})";
    row.facts_json = text;
    EXPECT_TRUE(ExtractDamage(ReadVerdict(*track->scoring.track, row).status())) << text;
  }
}

// What newer builds show beside the metrics comes from the facts, so that older builds' rows are
// still compared by the same keys.
TEST(JudgedRow, MetricsKeepTheirKeys) {
  const TrackPtr track = LoadTrack("manipulation");
  ASSERT_NE(track, nullptr);
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 4;
  facts.track = ManipulationFacts{.max_touch = 480.5, .effort_sum = 2};
  const auto row = JudgedRow(*track, facts);
  ASSERT_TRUE(row.ok()) << row.status();
  std::vector<std::string> keys;
  const nlohmann::json metrics = nlohmann::json::parse(row->metrics_json);
  for (const auto& [key, value] : metrics.items()) keys.push_back(key);
  EXPECT_THAT(keys, testing::ElementsAre("distance_m", "effort", "effort_sum", "pain", "pain_sum",
                                         "peak_force_n", "reported_time_s", "success", "time_s"));
  const auto aggregate = AggregateRows(*track->scoring.track, {*row});
  ASSERT_TRUE(aggregate.ok()) << aggregate.status();
  const nlohmann::json json = AggregateToJson(scoring::ScoredManipulation(), *aggregate);
  EXPECT_EQ(json["max_touch_n"], 480.5);
  EXPECT_EQ(json["effort_over_steps"], 0.5);
  EXPECT_TRUE(json["pain_over_steps"].is_null());
}

TEST(AggregateRows, AnOlderRowWithoutTheOfficialPeakHasNone) {
  const TrackPtr track = LoadTrack("manipulation");
  ASSERT_NE(track, nullptr);
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 4;
  facts.track = ManipulationFacts{};
  auto row = JudgedRow(*track, facts);
  ASSERT_TRUE(row.ok()) << row.status();
  nlohmann::json older = nlohmann::json::parse(row->facts_json);
  older["manipulation"].erase("max_touch");
  row->facts_json = older.dump();
  const auto aggregate = AggregateRows(*track->scoring.track, {*row});
  ASSERT_TRUE(aggregate.ok()) << aggregate.status();
  EXPECT_TRUE(AggregateToJson(scoring::ScoredManipulation(), *aggregate)["max_touch_n"].is_null());
}

TEST(AggregateRows, MeansAreOverTheEpisodes) {
  const TrackPtr track = LoadTrack("locomotion");
  ASSERT_NE(track, nullptr);
  std::vector<EpisodeRow> rows;
  for (const double distance : {1.0, 2.0, 6.0}) {
    const auto row = JudgedRow(*track, Walked(std::ssize(rows), distance));
    ASSERT_TRUE(row.ok()) << row.status();
    rows.push_back(*row);
  }
  const auto aggregate = AggregateRows(*track->scoring.track, rows);
  ASSERT_TRUE(aggregate.ok()) << aggregate.status();
  const nlohmann::json json = AggregateToJson(scoring::ScoredLocomotion(), *aggregate);
  EXPECT_EQ(json["episodes"], 3);
  EXPECT_EQ(json["successes"], 0);
  EXPECT_EQ(json["distance_m"], 3.0);
  EXPECT_EQ(json["effort"], 0.5);
  EXPECT_EQ(json["effort_over_steps"], 0.5);
  EXPECT_EQ(json["pain_over_steps"], 0.2);
  EXPECT_TRUE(json["peak_force_n"].is_null());
  EXPECT_TRUE(AggregateToJson(scoring::ScoredManipulation(), {}).is_null());
}

TEST(ComputeMerkleRoot, StaysForPublicSeedsAndCommitsToHiddenOnes) {
  std::vector<EpisodeRow> rows(2);
  for (int64_t i = 0; i < 2; ++i) {
    rows[static_cast<size_t>(i)].index = i;
    rows[static_cast<size_t>(i)].seed = static_cast<uint64_t>(5 + i);
    rows[static_cast<size_t>(i)].metrics_json = "{}";
  }
  EXPECT_EQ(ReceiptEntry(rows[0], "")["seed"], 5);
  const std::string salt(64, 'a');
  const nlohmann::json hidden = ReceiptEntry(rows[0], salt);
  EXPECT_FALSE(hidden.contains("seed"));
  EXPECT_EQ(hidden["seed_commitment"], SeedCommitment(salt, 0, 5));
  EXPECT_NE(ComputeMerkleRoot(rows, salt), ComputeMerkleRoot(rows, ""));
  EXPECT_NE(ComputeMerkleRoot(rows, salt), ComputeMerkleRoot(rows, std::string(64, 'b')));
  std::vector<EpisodeRow> other = rows;
  other[1].seed = 7;
  EXPECT_NE(ResultsHash(rows, salt), ResultsHash(other, salt));
}

TEST(ResultsHash, DependsOnResultsAndNotOnTheHostsClock) {
  const TrackPtr track = LoadTrack("locomotion");
  ASSERT_NE(track, nullptr);
  const auto hash = [&](const EpisodeFacts& facts) {
    const auto row = JudgedRow(*track, facts);
    return row.ok() ? ResultsHash({*row}, "") : std::string(row.status().message());
  };
  EpisodeFacts facts = Walked(0, 3);
  const std::string before = hash(facts);
  EXPECT_EQ(before.size(), 64u);
  facts.wall_s = 9;
  facts.policy_cpu_s = 3;
  EXPECT_EQ(hash(facts), before);
  facts.digest = "e";
  EXPECT_NE(hash(facts), before);
  EXPECT_NE(hash(Walked(0, 3.0000000000000004)), before);
}

}  // namespace
}  // namespace myograde::server
