#include "server/api/board_view.h"

#include <gtest/gtest.h>

#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

constexpr char kOne[] = R"({"models":{},"mujoco":"a","simulator":"b","version":"1"})";
constexpr char kSameParts[] = R"({"models":{},"mujoco":"a","simulator":"b","version":"2"})";
constexpr char kOther[] = R"({"models":{},"mujoco":"a","simulator":"c","version":"1"})";

TEST(BoardBuilds, TheBoardIsOfTheOneOfMostRows) {
  const BoardBuilds builds = CountBuilds({1, 2, 9}, {kOne, kSameParts, kOther});
  EXPECT_EQ(builds.own(), SimulatingBuild(kOne));
  ASSERT_EQ(builds.counts.size(), 2u);
  EXPECT_EQ(builds.counts[0].rows, 2u);
  EXPECT_EQ(builds.of_rows[2], SimulatingBuild(kOther));
}

TEST(BoardBuilds, OfEquallyManyTheNewestCounts) {
  EXPECT_EQ(CountBuilds({5, 2}, {kOne, kOther}).own(), SimulatingBuild(kOne));
  EXPECT_EQ(CountBuilds({2, 5}, {kOne, kOther}).own(), SimulatingBuild(kOther));
  EXPECT_EQ(CountBuilds({}, {}).own(), "");
}

}  // namespace
}  // namespace myograde::server
