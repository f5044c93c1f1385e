#include "server/sandbox/doctor_host.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

namespace myograde::server {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(DoctorMessages, AreMeasuredAndTheProcessorsStayAsTheyWere) {
  cpu_set_t before, after;
  ASSERT_EQ(sched_getaffinity(0, sizeof(before), &before), 0);
  const auto measured = MeasureMessages();
  ASSERT_EQ(sched_getaffinity(0, sizeof(after), &after), 0);
  EXPECT_TRUE(CPU_EQUAL(&before, &after));
  ASSERT_TRUE(measured.has_value());
  EXPECT_GT(*measured, absl::Nanoseconds(100));
  EXPECT_LT(*measured, absl::Seconds(1));
}

TEST(DoctorMessages, SlowOnesAreToldWithWhatMakesThemSlow) {
  const Check fine = JudgeMessages(absl::Microseconds(3), "");
  EXPECT_EQ(fine.state, CheckState::kOk);
  EXPECT_THAT(fine.found, HasSubstr("3.0 us"));
  EXPECT_THAT(fine.found, Not(HasSubstr("mitigations")));
  const Check slow = JudgeMessages(absl::Microseconds(20), "Safe RET");
  EXPECT_EQ(slow.state, CheckState::kDegraded);
  EXPECT_THAT(slow.found, HasSubstr("mitigations: Safe RET"));
  EXPECT_THAT(slow.costs, HasSubstr("results stay the same"));
  EXPECT_EQ(JudgeMessages(std::nullopt, "").state, CheckState::kDegraded);
}

}  // namespace
}  // namespace myograde::server
