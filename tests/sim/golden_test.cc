// How recordings say what was played.
#include "tests/sim/golden.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace myograde::sim {
namespace {

using nlohmann::json;
using Action = std::vector<double>;

TEST(RecordedAction, IsTheStepsOwnThenTheFilesThenNone) {
  const json file = {{"actions", {{0.5, -1}, {0.25, 1}}}};
  EXPECT_EQ(RecordedAction(file, {{"action", {3, 4}}}, 1), (Action{3, 4}));
  EXPECT_EQ(RecordedAction(file, {{"qpos", {1}}}, 0), (Action{0.5, -1}));
  EXPECT_EQ(RecordedAction(file, json(), 1), (Action{0.25, 1}));
  EXPECT_EQ(RecordedAction(json::object(), {{"qpos", {1}}}, 0), std::nullopt);
}

TEST(RecordedAction, AListThatIsTooShortIsAnError) {
  const json file = {{"actions", {{0.5, -1}}}};
  EXPECT_THROW(RecordedAction(file, json(), 1), std::runtime_error);
}

}  // namespace
}  // namespace myograde::sim
