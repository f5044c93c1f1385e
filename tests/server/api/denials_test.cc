#include "server/api/access_log.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

const Denial kRole = {"uid 7", "participant", "mark", "role"};
const Denial kTeam = {"uid 7", "participant", "read log", "another team's"};

int64_t Total(const std::vector<CountedDenial>& denials) {
  int64_t total = 0;
  for (const CountedDenial& counted : denials) total += counted.count;
  return total;
}

TEST(DenialCounterTest, TheFirstIsDueAtOnceAndEqualOnesAMinuteLater) {
  DenialCounter counter(10);
  const absl::Duration start = absl::Hours(3);
  counter.Add(kRole);
  std::vector<CountedDenial> due = counter.TakeDue(start);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].denial, kRole);
  EXPECT_EQ(due[0].count, 1);
  for (int i = 0; i < 5; ++i) counter.Add(kRole);
  counter.Add(kTeam);
  due = counter.TakeDue(start + absl::Seconds(59));
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].denial, kTeam);
  due = counter.TakeDue(start + DenialCounter::kEvery);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].denial, kRole);
  EXPECT_EQ(due[0].count, 5);
  EXPECT_TRUE(counter.TakeDue(start + absl::Hours(1)).empty());
}

TEST(DenialCounterTest, TooManyDifferentOnesAreCountedAsOthers) {
  DenialCounter counter(3);
  for (int i = 0; i < 1000; ++i) {
    counter.Add({absl::StrCat("address ", i), "public", "submit", "role"});
  }
  std::vector<CountedDenial> due = counter.TakeDue(absl::Hours(1));
  ASSERT_EQ(due.size(), 4u);
  EXPECT_EQ(Total(due), 1000);
  // A kind keeps its place for a minute, so that a minute has so many rows and no more.
  counter.Add({"address 2000", "public", "submit", "role"});
  EXPECT_TRUE(counter.TakeDue(absl::Hours(1) + absl::Seconds(1)).empty());
  due = counter.TakeDue(absl::Hours(1) + DenialCounter::kEvery);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].denial, DenialCounter::Others());
  counter.Add({"address 2000", "public", "submit", "role"});
  due = counter.TakeDue(absl::Hours(1) + 2 * DenialCounter::kEvery);
  ASSERT_EQ(due.size(), 1u);
  EXPECT_EQ(due[0].denial.who, "address 2000");
}

RC_GTEST_PROP(DenialCounterProperties, EveryDenialIsCountedOnce, ()) {
  DenialCounter counter(3);
  absl::Duration now;
  int64_t added = 0;
  int64_t written = 0;
  for (const int step : *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 9))) {
    if (step < 6) {
      counter.Add({absl::StrCat("uid ", step), "participant", "mark", "role"});
      ++added;
      continue;
    }
    now += absl::Seconds(25);
    const std::vector<CountedDenial> due = counter.TakeDue(now);
    RC_ASSERT(due.size() <= 4u);
    if (step == 6) {
      counter.Return(due);  // the store did not take them
    } else {
      written += Total(due);
    }
  }
  RC_ASSERT(written + Total(counter.TakeDue(absl::InfiniteDuration())) == added);
  RC_ASSERT(counter.TakeDue(absl::InfiniteDuration()).empty());
}

}  // namespace
}  // namespace myograde::server
