#include "server/access/rate_limit.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr absl::Duration kNone = absl::ZeroDuration();

TEST(RateLimitTest, ABurstIsServedAndThenTheRate) {
  RateLimit limit(/*per_s=*/2, /*burst=*/3, /*most_keys=*/10);
  const absl::Duration start = absl::Hours(5);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(limit.Take("a", start), kNone);
  EXPECT_EQ(limit.Take("a", start), absl::Milliseconds(500));
  EXPECT_EQ(limit.Take("b", start), kNone) << "another caller has a bucket of their own";
  EXPECT_EQ(limit.Take("a", start + absl::Milliseconds(500)), kNone);
  EXPECT_GT(limit.Take("a", start + absl::Milliseconds(500)), kNone);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(limit.Take("a", start + absl::Hours(1)), kNone);
  EXPECT_GT(limit.Take("a", start + absl::Hours(1)), kNone) << "more than a burst is not saved up";
}

TEST(RateLimitTest, WhoIsRefusedWaitsNoLongerForAsking) {
  RateLimit limit(1, 1, 10);
  EXPECT_EQ(limit.Take("a", kNone), kNone);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(limit.Take("a", kNone), absl::Seconds(1));
  EXPECT_EQ(limit.Take("a", absl::Seconds(1)), kNone);
}

TEST(RateLimitTest, WhoOnlyAsksIsNotCounted) {
  RateLimit limit(/*per_s=*/1, /*burst=*/1, /*most_keys=*/10);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(limit.Take("a", kNone, /*count=*/false), kNone);
  EXPECT_EQ(limit.Take("a", kNone), kNone);
  EXPECT_EQ(limit.Take("a", absl::Milliseconds(500), /*count=*/false), absl::Milliseconds(500));
  EXPECT_EQ(limit.Take("a", absl::Seconds(1), /*count=*/false), kNone);
}

TEST(RateLimitTest, WhatRoundingLeavesOfAWaitIsNoRequestForFree) {
  RateLimit limit(/*per_s=*/4, /*burst=*/2, /*most_keys=*/10);
  // The bucket of the fourth holds one less rounding: 1 - 2^-53.
  for (const int at_ms : {0, 215, 274, 500}) {
    EXPECT_EQ(limit.Take("a", absl::Milliseconds(at_ms)), kNone) << at_ms;
  }
  EXPECT_EQ(limit.Take("a", absl::Milliseconds(500)), absl::Milliseconds(250));
}

TEST(RateLimitTest, MemoryIsBoundedAndTheIdleAreForgottenFirst) {
  RateLimit limit(0.001, 1, 3);
  for (const char* key : {"a", "b", "c"}) EXPECT_EQ(limit.Take(key, kNone), kNone);
  EXPECT_GT(limit.Take("a", kNone), kNone);
  EXPECT_EQ(limit.Take("d", kNone), kNone);  // in the place of b
  EXPECT_EQ(limit.keys(), 3u);
  EXPECT_GT(limit.Take("a", kNone), kNone);
  EXPECT_GT(limit.Take("c", kNone), kNone);
  for (int i = 0; i < 1000; ++i) limit.Take(absl::StrCat("address ", i), kNone);
  EXPECT_EQ(limit.keys(), 3u);
}

RC_GTEST_PROP(RateLimitProperties, NoOneGetsMoreThanBurstAndRate, ()) {
  const double per_s = *rc::gen::inRange(1, 20);
  const double burst = *rc::gen::inRange(1, 20);
  RateLimit limit(per_s, burst, 4);
  absl::Duration now;
  int served = 0;
  for (const int pause_ms : *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 400))) {
    now += absl::Milliseconds(pause_ms);
    const absl::Duration wait = limit.Take("a", now);
    if (wait == kNone) {
      ++served;
    } else {
      // Whoever waits as long as they are told is served.
      now += wait + absl::Nanoseconds(1);
      RC_ASSERT(limit.Take("a", now) == kNone);
      ++served;
    }
  }
  RC_ASSERT(served <= burst + per_s * absl::ToDoubleSeconds(now) + 1e-6);
}

TEST(BackOffTest, TheFirstFailuresCostNothingAndThenTimeGrows) {
  BackOff back_off(10);
  absl::Duration now = absl::Hours(1);
  for (int i = 0; i < BackOff::kFree; ++i) {
    back_off.Fail("a", now);
    EXPECT_EQ(back_off.Wait("a", now), kNone);
  }
  absl::Duration last;
  for (int i = 0; i < 20; ++i) {
    back_off.Fail("a", now);
    const absl::Duration wait = back_off.Wait("a", now);
    EXPECT_EQ(wait, i == 0 ? BackOff::kFirst : std::min(last * 2, BackOff::kLongest));
    EXPECT_EQ(back_off.Wait("b", now), kNone);
    last = wait;
    now += wait;
    EXPECT_EQ(back_off.Wait("a", now), kNone);
  }
  EXPECT_EQ(last, BackOff::kLongest);
}

TEST(BackOffTest, FailuresOfLongAgoAreForgotten) {
  BackOff back_off(10);
  for (int i = 0; i < 10; ++i) back_off.Fail("a", kNone);
  back_off.Fail("a", BackOff::kForget);
  EXPECT_EQ(back_off.Wait("a", BackOff::kForget), kNone);
}

TEST(BackOffTest, MemoryIsBounded) {
  BackOff back_off(5);
  for (int i = 0; i < 1000; ++i) back_off.Fail(absl::StrCat("address ", i), kNone);
  EXPECT_EQ(back_off.keys(), 5u);
  EXPECT_EQ(back_off.Wait("address 1", kNone), kNone);
}

TEST(RecentKeysTest, ForgetsWhatIsAskedFor) {
  RecentKeys<int> keys(2);
  keys.FindOr("a", 1) = 5;
  EXPECT_EQ(*keys.Find("a"), 5);
  EXPECT_EQ(keys.FindOr("a", 9), 5);
  keys.Forget("a");
  keys.Forget("never there");
  EXPECT_EQ(keys.Find("a"), nullptr);
  EXPECT_EQ(keys.size(), 0u);
}

}  // namespace
}  // namespace myograde::server
