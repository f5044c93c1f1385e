// The tables of the elbow's vectors against the environment, and its facts as JSON.
#include "protocol/tracks/elbow/track.h"

#include <cmath>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "tests/sim/elbow/helpers.h"

namespace myograde::sim {
namespace {

TEST(ElbowLayout, HasTheSizesOfTheEnvironment) {
  const TrackLayout& layout = ElbowLayout();
  const auto env = MakeElbowProfile("hold");
  EXPECT_EQ(layout.observation.names().size(), env->observation_size());
  EXPECT_EQ(layout.action.names().size(), env->action_size());
  EXPECT_EQ(layout.direct_bounds.size(), env->action_size());
}

TEST(ElbowLayout, NamesTheMusclesAsTheModelDoes) {
  const TrackLayout& layout = ElbowLayout();
  const auto env = MakeElbowProfile("hold");
  for (int i = 0; i < env->action_size(); ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names()[i], "muscles." + muscle);
    EXPECT_EQ(layout.observation.names()[3 + i], "act." + muscle);
  }
}

TEST(ElbowLayout, TheControlPeriodIsThatOfTheEnvironment) {
  const auto env = MakeElbowProfile("hold");
  EXPECT_DOUBLE_EQ(ElbowTrack().control_period_s,
                   ElbowEnvironment::kPhysicsSteps * env->model().opt.timestep);
}

TEST(ElbowLayout, ObservationsStayWithinTheirBounds) {
  const auto bounds = ElbowLayout().observation.bounds();
  const auto env = MakeElbowProfile("hold");
  std::vector<double> seen(env->observation_size());
  for (const double flexors : {-1.0, 1.0}) {  // hard into each of the joint's stops
    env->Reset(5);
    for (int t = 0; t < 100; ++t) {
      env->Step(std::vector<double>{-flexors, -flexors, -flexors, flexors, flexors, flexors});
      env->Observe(seen);
      for (size_t i = 0; i < seen.size(); ++i) {
        ASSERT_TRUE(seen[i] >= bounds[i].low && seen[i] <= bounds[i].high)
            << "entry " << i << " is " << seen[i];
      }
    }
  }
}

TEST(ElbowFacts, SurviveTheirJson) {
  EpisodeFacts facts;
  facts.end = ElbowEnd::kHeld;
  auto& elbow = facts.track.emplace<ElbowFacts>();
  double next = 0.5;
  std::set<std::string> keys;
  ElbowFacts::Visit(elbow, [&](const char* key, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
    keys.insert(key);
  });
  EXPECT_EQ(keys.size(), 12);
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->end, ElbowEnd::kHeld);
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<ElbowFacts>(back->track).reported_time, elbow.reported_time);
}

}  // namespace
}  // namespace myograde::sim
