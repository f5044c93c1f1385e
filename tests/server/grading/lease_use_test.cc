#include "server/grading/results.h"

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

EpisodeRow Used(int64_t index, const char* facts) {
  EpisodeRow row;
  row.index = index;
  row.facts_json = facts;
  return row;
}

TEST(LeaseUse, WhatIsNoPartOfAnEpisodeIsTheStart) {
  const std::vector<EpisodeRow> rows = {Used(0, R"({"policy_cpu_s": 99, "wall_s": 99})"),
                                        Used(1, R"({"policy_cpu_s": 1, "wall_s": 2})"),
                                        Used(2, R"({"policy_cpu_s": 0.5, "wall_s": 3})"),
                                        Used(3, R"({"policy_cpu_s": 99, "wall_s": 99})")};
  nlohmann::json use = {{"policy_cpu_s", 4.0}, {"wall_s", 7.5}};
  AddStartUp(rows, 1, 2, use);
  EXPECT_EQ(use["startup_cpu_s"], 2.5);
  EXPECT_EQ(use["startup_wall_s"], 2.5);
}

TEST(LeaseUse, NothingIsSaidOfWhatWasNotMeasuredAndNothingIsBelowZero) {
  nlohmann::json use = {{"policy_cpu_s", 1.0}};
  AddStartUp({Used(0, "[]"), Used(1, R"({"policy_cpu_s": 1.5, "wall_s": "x"})"), Used(2, "{")}, 0, 2, use);
  EXPECT_EQ(use, (nlohmann::json{{"policy_cpu_s", 1.0}, {"startup_cpu_s", 0.0}}));
}

}  // namespace
}  // namespace myograde::server
