#include "server/artefact/known_archives.h"

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TEST(KnownArchives, KeepsTheNewestAndForgetsTheOldest) {
  KnownArchives known(2);
  EXPECT_EQ(known.Find("a"), std::nullopt);
  known.Learn("a", "one");
  known.Learn("b", "two");
  EXPECT_EQ(known.Find("a"), "one");
  known.Learn("c", "three");
  EXPECT_EQ(known.Find("a"), std::nullopt);
  EXPECT_EQ(known.Find("b"), "two");
  EXPECT_EQ(known.Find("c"), "three");
}

TEST(KnownArchives, LearningAgainTakesNoSecondPlace) {
  KnownArchives known(2);
  known.Learn("a", "one");
  for (int i = 0; i < 5; ++i) known.Learn("b", "two");
  EXPECT_EQ(known.Find("a"), "one");
  known.Learn("b", "other");
  EXPECT_EQ(known.Find("b"), "other");
}

}  // namespace
}  // namespace myograde::server
