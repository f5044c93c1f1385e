// Suggestions for mistyped words.
#include <gtest/gtest.h>

#include "server/cli/base/verbs.h"

namespace myograde::server {
namespace {

TEST(DidYouMean, MistypedWordsHaveANearestOrNone) {
  const std::vector<std::string> verbs = {"submit", "show", "status", "seeds", "serve", "hide",
                                          "unhide", "leaderboard"};
  EXPECT_EQ(FindNearest("sbmit", verbs), "submit");
  EXPECT_EQ(FindNearest("sumbit", verbs), "submit");
  EXPECT_EQ(FindNearest("leader", verbs), "leaderboard");
  EXPECT_EQ(FindNearest("statsu", verbs), "status");
  EXPECT_EQ(FindNearest("paint", verbs), "");
  EXPECT_EQ(FindNearest("s", verbs), "") << "several begin with it";
  EXPECT_EQ(FindNearest("", verbs), "");
  EXPECT_EQ(FindNearest(std::string(100000, 'x'), verbs), "");
}

}  // namespace
}  // namespace myograde::server
