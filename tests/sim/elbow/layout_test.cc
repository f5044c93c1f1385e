// The tables of the elbow's vectors against the environment, and its facts as JSON.
#include "protocol/tracks/elbow/layout.h"

#include <cmath>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease.h"
#include "protocol/sim_channel.h"
#include "tests/sim/elbow/helpers.h"

namespace myograde::sim {
namespace {

using layout_tables::ElbowLayout;

TEST(ElbowLayout, HasTheSizesOfTheEnvironment) {
  const auto layout = ElbowLayout();
  const auto env = MakeElbowProfile("hold");
  EXPECT_EQ(layout.observation.names().size(), env->observation_size());
  EXPECT_EQ(layout.action.names().size(), env->action_size());
  EXPECT_EQ(layout.direct_bounds.size(), env->action_size());
}

TEST(ElbowLayout, NamesTheMusclesAsTheModelDoes) {
  const auto layout = ElbowLayout();
  const auto env = MakeElbowProfile("hold");
  for (int i = 0; i < env->action_size(); ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names().at(i), "muscles." + muscle);
    EXPECT_EQ(layout.observation.names().at(3 + i), "act." + muscle);
  }
}

TEST(ElbowLayout, TheControlPeriodIsThatOfTheEnvironment) {
  const auto env = MakeElbowProfile("hold");
  EXPECT_DOUBLE_EQ(kElbowControlPeriod,
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
  facts.end = EpisodeEnd::kHeld;
  auto& elbow = facts.track.emplace<ElbowFacts>();
  double next = 0.5;
  std::set<std::string> keys;
  VisitElbow(elbow, [&](const char* key, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
    keys.insert(key);
  });
  EXPECT_EQ(keys.size(), 12);
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->end, EpisodeEnd::kHeld);
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<ElbowFacts>(back->track).reported_time, elbow.reported_time);
}

}  // namespace
}  // namespace myograde::sim
