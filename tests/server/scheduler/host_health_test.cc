// When a host is suspected, tested, paused and resumed.
#include "server/scheduler/host_health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using State = HostHealth::State;
using ::testing::HasSubstr;

constexpr HostLimits kLimits = {.suspect_after = 2};
const absl::Duration kMinute = absl::Minutes(1);

TEST(HostHealthTest, FaultsInARowBringATestAndOneLeaseWellPlayedForgetsThem) {
  HostHealth host(kLimits);
  host.LeaseFaulted(kMinute, "x");
  host.LeaseDone();
  host.LeaseFaulted(kMinute, "x");
  EXPECT_TRUE(host.may_start());
  EXPECT_FALSE(host.TestDue(kMinute));
  host.LeaseFaulted(kMinute, "the simulator vanished");
  EXPECT_EQ(host.state(), State::kSuspected);
  EXPECT_FALSE(host.may_start());
  EXPECT_TRUE(host.TestDue(kMinute));
  EXPECT_THAT(host.PauseReason(kMinute), HasSubstr("the simulator vanished"));
}

TEST(HostHealthTest, AHostThatPassesGoesOnAndIsNotTestedAtEveryFurtherFault) {
  HostHealth host(kLimits);
  for (int i = 0; i < 2; ++i) host.LeaseFaulted(kMinute, "x");
  host.TestBegins();
  EXPECT_FALSE(host.TestDue(kMinute)) << "one at a time";
  host.TestEnded(kMinute, "");
  EXPECT_TRUE(host.may_start());
  EXPECT_EQ(host.PauseReason(kMinute), "");
  for (int i = 0; i < 5; ++i) host.LeaseFaulted(2 * kMinute, "x");
  EXPECT_TRUE(host.may_start());
  host.LeaseFaulted(5 * kMinute, "x");
  EXPECT_EQ(host.state(), State::kSuspected);
}

TEST(HostHealthTest, AHostThatFailsIsPausedUntilALaterTestPasses) {
  HostHealth host(kLimits);
  for (int i = 0; i < 2; ++i) host.LeaseFaulted(kMinute, "x");
  host.TestBegins();
  host.TestEnded(kMinute, "no models");
  EXPECT_EQ(host.state(), State::kPaused);
  EXPECT_EQ(host.paused_since(), kMinute);
  EXPECT_EQ(host.NextTest(), 4 * kMinute);
  EXPECT_THAT(host.PauseReason(2 * kMinute), HasSubstr("no models; it is tested again in 2m"));
  EXPECT_FALSE(host.TestDue(4 * kMinute - absl::Seconds(1)));
  ASSERT_TRUE(host.TestDue(4 * kMinute));
  host.TestBegins();
  host.TestEnded(4 * kMinute, "still no models");
  EXPECT_EQ(host.paused_since(), kMinute);
  EXPECT_FALSE(host.TestDue(4 * kMinute));
  host.TestBegins();
  host.TestEnded(7 * kMinute, "");
  EXPECT_TRUE(host.may_start());
}

}  // namespace
}  // namespace myograde::server
