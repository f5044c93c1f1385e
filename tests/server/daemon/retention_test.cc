// Which files a policy lets go.
#include "server/daemon/retention.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int64_t kDay = 24 * 60 * 60 * 1000;

std::vector<std::string> Chosen(std::vector<KeptFile> files, int days, int64_t bytes) {
  std::vector<std::string> names;
  for (const Choice& choice : ChooseRemovals(std::move(files), absl::Hours(24 * days), bytes,
                                             /*now_ms=*/100 * kDay)) {
    EXPECT_FALSE(choice.why.empty());
    names.push_back(choice.file.name);
  }
  return names;
}

TEST(Retention, TheOldGoAndTheNeededStay) {
  const std::vector<KeptFile> files = {{"old", "", 10, 10 * kDay, false},
                                       {"needed", "", 10, 5 * kDay, true},
                                       {"new", "", 10, 95 * kDay, false},
                                       {"older", "", 10, 1 * kDay, false}};
  EXPECT_THAT(Chosen(files, 30, 1000), ElementsAre("older", "old"));
  EXPECT_THAT(Chosen(files, 100, 1000), IsEmpty());
}

TEST(Retention, TheOldestGoUntilTheRestIsSmallEnough) {
  const std::vector<KeptFile> files = {{"c", "", 10, 30 * kDay, false},
                                       {"needed", "", 50, 5 * kDay, true},
                                       {"b", "", 10, 20 * kDay, false},
                                       {"a", "", 10, 20 * kDay, false}};
  EXPECT_THAT(Chosen(files, 365, 80), IsEmpty());
  EXPECT_THAT(Chosen(files, 365, 79), ElementsAre("a"));
  EXPECT_THAT(Chosen(files, 365, 60), ElementsAre("a", "b"));
  EXPECT_THAT(Chosen(files, 365, 1), ElementsAre("a", "b", "c"));
}

TEST(Retention, ALastUseInTheFutureIsNoReasonToGo) {
  EXPECT_THAT(Chosen({{"jumped", "", 10, 900 * kDay, false}}, 1, 1000), IsEmpty());
}

}  // namespace
}  // namespace myograde::server
