// Which builds of the grader give the same facts.
#include "server/proof/grader_build.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace myograde::server {
namespace {

TEST(SameSimulation, ComparesTheAdaptersThatTheFirstBuildNames) {
  const nlohmann::json plain = {{"simulator", "a"}, {"mujoco", "b"}, {"models", nlohmann::json::object()}};
  nlohmann::json adapted = plain;
  adapted["adapters"]["template-2024"] = "c";
  nlohmann::json changed = adapted;
  changed["adapters"]["template-2024"] = "d";
  EXPECT_TRUE(SameSimulation(plain, adapted));
  EXPECT_TRUE(SameSimulation(adapted, adapted));
  EXPECT_FALSE(SameSimulation(adapted, changed));
  EXPECT_FALSE(SameSimulation(adapted, plain));
}

TEST(SimulatingBuild, IsToldByWhatSimulates) {
  constexpr char kOne[] = R"({"models":{},"mujoco":"a","simulator":"b","version":"1"})";
  constexpr char kSameParts[] = R"({"models":{},"mujoco":"a","simulator":"b","version":"2"})";
  constexpr char kOther[] = R"({"models":{},"mujoco":"a","simulator":"c","version":"1"})";
  EXPECT_EQ(SimulatingBuild(kOne).size(), 12u);
  EXPECT_EQ(SimulatingBuild(kOne), SimulatingBuild(kSameParts));
  EXPECT_NE(SimulatingBuild(kOne), SimulatingBuild(kOther));
  EXPECT_EQ(SimulatingBuild("[]"), "");
}

}  // namespace
}  // namespace myograde::server
