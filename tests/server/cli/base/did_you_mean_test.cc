// Suggestions for mistyped words.
#include <gtest/gtest.h>

#include "server/cli/base/verbs.h"

namespace myograde::server {
namespace {

TEST(DidYouMean, MistypedWordsHaveANearestOrNone) {
  const std::vector<std::string> verbs = {"submit", "show", "status", "seeds", "serve", "hide",
                                          "unhide", "leaderboard"};
  EXPECT_EQ(NearestOf("sbmit", verbs), "submit");
  EXPECT_EQ(NearestOf("sumbit", verbs), "submit");
  EXPECT_EQ(NearestOf("leader", verbs), "leaderboard");
  EXPECT_EQ(NearestOf("statsu", verbs), "status");
  EXPECT_EQ(NearestOf("paint", verbs), "");
  EXPECT_EQ(NearestOf("s", verbs), "") << "several begin with it";
  EXPECT_EQ(NearestOf("", verbs), "");
  EXPECT_EQ(NearestOf(std::string(100000, 'x'), verbs), "");
}

}  // namespace
}  // namespace myograde::server
