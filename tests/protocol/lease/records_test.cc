#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;

EpisodeFacts ArmFacts() {
  EpisodeFacts facts;
  facts.index = 17;
  facts.seed = std::numeric_limits<uint64_t>::max();
  facts.end = ManipulationEnd::kDropped;
  facts.steps = 123;
  facts.sim_time = 1.23;
  facts.clipped = 4;
  facts.digest = std::string(64, 'a');
  ManipulationFacts arm;
  arm.frames = 124;
  arm.frames_arm = 3;
  arm.frames_prosthesis = 5;
  arm.frames_start = 7;
  arm.frames_goal = 11;
  arm.frames_other = 13;
  arm.goal_only_at_end = true;
  arm.placed = true;
  arm.solved = true;
  arm.solved_steps = 2;
  arm.peak_force = 0.1;
  arm.max_touch = 1e-300;
  arm.goal_distance_sum = 1.0 / 3;
  arm.final_goal_distance = 0.7;
  arm.final_hand_distance = 0.8;
  arm.max_height = -0.0;
  arm.effort_sum = 1e17 + 2;
  arm.reported_time = 10;
  facts.track = arm;
  facts.wall_s = 2.5;
  facts.policy_cpu_s = 0.5;
  return facts;
}

EpisodeFacts LegFault() {
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kFault;
  facts.fault = {Outcome::kStepTimeout, "step_s", 1, 61.5, 9, "step 9 took \"long\"\n\x01", "tail"};
  LocomotionFacts leg;
  leg.course = 4;
  leg.distance = 12.5;
  leg.start_y = 55;
  leg.min_y = 42.5;
  leg.final_y = 43;
  leg.effort_sum = 3;
  leg.pain_sum = 4;
  leg.solved = true;
  leg.reported_time = 300;
  facts.track = leg;
  return facts;
}

// Equal texts mean equal values: every field is written, doubles exactly.
void RoundTrip(const LeaseRecord& record) {
  const std::string line = LeaseRecordToLine(record);
  EXPECT_EQ(line.find('\n'), std::string::npos);
  const auto back = LeaseRecordFromLine(line);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->index(), record.index());
  EXPECT_EQ(LeaseRecordToLine(*back), line);
}

TEST(Records, EveryKindComesBack) {
  RoundTrip(ProgressRecord{4, 99});
  RoundTrip(ArmFacts());
  RoundTrip(LegFault());
  LeaseEndRecord end;
  end.ok = true;
  end.detail = "d";
  end.stdout_tail = "caf\xc3\xa9\n";
  end.stderr_tail = "x";
  end.stderr_truncated = true;
  end.policy_cpu_s = 1.5;
  end.simulator_cpu_s = 1.25;
  end.wall_s = 2.5;
  end.peak_memory_bytes = int64_t{1} << 40;
  RoundTrip(end);
}

TEST(Records, ValuesSurviveExactly) {
  const auto back = LeaseRecordFromLine(LeaseRecordToLine(ArmFacts()));
  ASSERT_TRUE(back.ok()) << back.status();
  const auto& facts = std::get<EpisodeFacts>(*back);
  EXPECT_EQ(facts.seed, std::numeric_limits<uint64_t>::max());
  const auto& arm = std::get<ManipulationFacts>(facts.track);
  EXPECT_EQ(arm.max_touch, 1e-300);
  EXPECT_EQ(arm.goal_distance_sum, 1.0 / 3);
  EXPECT_TRUE(arm.goal_only_at_end);
  const auto fault = LeaseRecordFromLine(LeaseRecordToLine(LegFault()));
  ASSERT_TRUE(fault.ok()) << fault.status();
  EXPECT_EQ(std::get<EpisodeFacts>(*fault).fault.outcome, Outcome::kStepTimeout);
  EXPECT_EQ(std::get<EpisodeFacts>(*fault).fault.detail, "step 9 took \"long\"\n\x01");
  EXPECT_EQ(std::get<EpisodeFacts>(*fault).fault.stderr_tail, "tail");
}

TEST(Records, DoublesComeBackBitForBit) {
  EXPECT_TRUE(rc::check([](double value) {
    RC_PRE(std::isfinite(value));
    EpisodeFacts facts = ArmFacts();
    std::get<ManipulationFacts>(facts.track).effort_sum = value;
    const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
    RC_ASSERT(back.ok());
    RC_ASSERT(std::get<ManipulationFacts>(back->track).effort_sum == value);
  }));
}

TEST(Records, EachMissingOrUnknownKeyIsAnError) {
  const nlohmann::json good = nlohmann::json::parse(LeaseRecordToLine(ArmFacts()));
  for (const auto& [key, value] : good.items()) {
    nlohmann::json broken = good;
    broken.erase(key);
    EXPECT_FALSE(LeaseRecordFromLine(broken.dump()).ok()) << key;
  }
  for (const auto& [key, value] : good["manipulation"].items()) {
    nlohmann::json broken = good;
    broken["manipulation"].erase(key);
    EXPECT_THAT(std::string(LeaseRecordFromLine(broken.dump()).status().message()),
                HasSubstr(key));
    broken = good;
    broken["manipulation"][key] = "text";
    EXPECT_FALSE(LeaseRecordFromLine(broken.dump()).ok()) << key;
  }
  nlohmann::json extra = good;
  extra["surprise"] = 1;
  EXPECT_THAT(std::string(LeaseRecordFromLine(extra.dump()).status().message()),
              HasSubstr("surprise"));
}

TEST(Records, NonsenseIsAnErrorAndNeverACrash) {
  for (const char* line : {"", "{", "[]", "null", "7", "\"progress\"", "{}", R"({"type":1})",
                           R"({"type":"unknown"})", R"({"type":"episode"})",
                           R"({"type":"episode","track":"locomotion","locomotion":[]})",
                           R"({"type":"progress","episode":-1,"step":0})",
                           R"({"type":"progress","episode":1e99,"step":0})",
                           R"({"type":"progress","type":"progress","episode":1,"step":0})"}) {
    EXPECT_FALSE(LeaseRecordFromLine(line).ok()) << line;
  }
  EXPECT_TRUE(rc::check([](const std::string& noise) { (void)LeaseRecordFromLine(noise).ok(); }));
}

TEST(Evidence, ComesBackAndIsStrict) {
  FaultEvidence evidence = LegFault().fault;
  const auto back = FaultEvidenceFromJson(FaultEvidenceToJson(evidence));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->limit, "step_s");
  EXPECT_EQ(back->value, 61.5);
  nlohmann::json wrong = FaultEvidenceToJson(evidence);
  wrong["outcome"] = "splendid";
  EXPECT_THAT(std::string(FaultEvidenceFromJson(wrong).status().message()), HasSubstr("outcome"));
}

LeaseOrder DemoOrder() {
  LeaseOrder order;
  order.lease = "evaluation-1.0";
  order.artefact_dir = "/somewhere/artefact";
  order.command = {"./policy", "--fast"};
  order.runtimes = {"/opt/runtime"};
  order.episodes = {{3, 11, std::numeric_limits<uint64_t>::max()}, {4, 12, 0}};
  order.uid = 60001;
  order.slot = 1;
  order.slot_mark = "/somewhere/slots/1";
  order.work_dir = "/somewhere/work";
  order.cache_dir = "/somewhere/cache";
  const auto track =
      LoadTrackConfig(std::string(MYOGRADE_SOURCE_DIR) + "/configs/tracks", "manipulation", "");
  EXPECT_TRUE(track.ok()) << track.status();
  if (track.ok()) order.track = *track;
  return order;
}

TEST(LeaseOrder, ComesBack) {
  const LeaseOrder order = DemoOrder();
  const nlohmann::json written = LeaseOrderToJson(order);
  const auto back = LeaseOrderFromJson(written, "order");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(LeaseOrderToJson(*back), written);
  EXPECT_EQ(back->track.hash, order.track.hash);
  EXPECT_EQ(back->episodes[0].policy_seed, std::numeric_limits<uint64_t>::max());
}

TEST(LeaseOrder, MayAskForExtraObservations) {
  LeaseOrder order = DemoOrder();
  order.extra_observations = true;
  nlohmann::json written = LeaseOrderToJson(order);
  EXPECT_TRUE(LeaseOrderFromJson(written, "order")->extra_observations);
  written["extra_observations"] = 1;
  EXPECT_THAT(std::string(LeaseOrderFromJson(written, "order").status().message()),
              HasSubstr("extra_observations"));
}

TEST(LeaseOrder, MayNameAnAdapter) {
  LeaseOrder order = DemoOrder();
  order.adapter = "template-2024";
  const auto back = LeaseOrderFromJson(LeaseOrderToJson(order), "order");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->adapter, "template-2024");
}

TEST(LeaseOrder, MayAskForATrajectoryOfALog) {
  LeaseOrder order = DemoOrder();
  order.trajectory = "/somewhere/trajectory";
  EXPECT_THAT(std::string(LeaseOrderFromJson(LeaseOrderToJson(order), "order").status().message()),
              HasSubstr("\"replay\" names none"));
  order.replay = {"/a.lcmlog", "/b.lcmlog"};
  order.background = true;
  const auto back = LeaseOrderFromJson(LeaseOrderToJson(order), "order");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->trajectory, order.trajectory);
  EXPECT_TRUE(back->background);
}

TEST(LeaseOrder, MistakesAreNamed) {
  const nlohmann::json good = LeaseOrderToJson(DemoOrder());
  nlohmann::json wrong = good;
  wrong["episodes"] = nlohmann::json::array();
  EXPECT_THAT(std::string(LeaseOrderFromJson(wrong, "order").status().message()),
              HasSubstr("at least one"));
  wrong = good;
  wrong["episodes"][1]["index"] = 9;
  EXPECT_THAT(std::string(LeaseOrderFromJson(wrong, "order").status().message()),
              HasSubstr("episodes[1]"));
  wrong = good;
  wrong["command"] = nlohmann::json::array();
  EXPECT_THAT(std::string(LeaseOrderFromJson(wrong, "order").status().message()),
              HasSubstr("command"));
  wrong = good;
  wrong["episodes"][0]["seed"] = -1;
  EXPECT_THAT(std::string(LeaseOrderFromJson(wrong, "order").status().message()),
              HasSubstr("seed"));
}

}  // namespace
}  // namespace myograde
