// Which builds of the grader give the same facts.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "server/engine/rejudges.h"

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

}  // namespace
}  // namespace myograde::server
