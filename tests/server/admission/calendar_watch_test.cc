#include "server/admission/admission.h"

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

class CalendarWatchTest : public ::testing::Test {
 protected:
  std::optional<absl::Duration> Jump() { return watch_.Jump(clock_.Now(), clock_.Monotonic()); }

  ManualClock clock_{absl::FromUnixSeconds(1'700'000'000)};
  CalendarWatch watch_;
};

TEST_F(CalendarWatchTest, TimeThatPassesIsNoJump) {
  EXPECT_EQ(Jump(), std::nullopt);
  clock_.Advance(absl::Hours(1000));
  EXPECT_EQ(Jump(), std::nullopt);
}

TEST_F(CalendarWatchTest, EachJumpIsToldOnce) {
  EXPECT_EQ(Jump(), std::nullopt);
  clock_.Jump(absl::Hours(2));
  EXPECT_EQ(Jump(), absl::Hours(2));
  EXPECT_EQ(Jump(), std::nullopt);
  clock_.Jump(-absl::Hours(3));
  EXPECT_EQ(Jump(), -absl::Hours(3));
  EXPECT_EQ(Jump(), std::nullopt);
}

TEST_F(CalendarWatchTest, SmallAdjustmentsAreNoneAndDoNotAddUp) {
  EXPECT_EQ(Jump(), std::nullopt);
  for (int i = 0; i < 100; ++i) {
    clock_.Jump(absl::Seconds(59));
    EXPECT_EQ(Jump(), std::nullopt);
  }
  clock_.Jump(absl::Seconds(61));
  EXPECT_EQ(Jump(), absl::Seconds(61));
}

}  // namespace
}  // namespace myograde::server
