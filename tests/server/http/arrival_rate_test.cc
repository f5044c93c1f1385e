#include "server/http/connection_table.h"

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TEST(ArrivalRateTest, AllowsABurstAndThenTheRate) {
  ArrivalRate rate(/*per_s=*/10, /*burst=*/20);
  const absl::Duration start = absl::Seconds(100);
  int allowed = 0;
  for (int i = 0; i < 1000; ++i) {
    const absl::Duration now = start + i * absl::Milliseconds(10);  // 10 s
    if (!rate.Allows("a", now)) continue;
    rate.Count("a", now);
    ++allowed;
  }
  EXPECT_GE(allowed, 20 + 98);
  EXPECT_LE(allowed, 20 + 100);
  EXPECT_TRUE(rate.Allows("b", start)) << "another's count is another's";
}

TEST(ArrivalRateTest, ForgetsNobodyWhoStillCounts) {
  ArrivalRate rate(1, 1);
  rate.Count("a", absl::Seconds(10));
  rate.LookAtClocks(absl::Seconds(10.5));
  EXPECT_FALSE(rate.Allows("a", absl::Seconds(10.5)));
  rate.LookAtClocks(absl::Seconds(11));
  EXPECT_TRUE(rate.Allows("a", absl::Seconds(11)));
}

}  // namespace
}  // namespace myograde::server
