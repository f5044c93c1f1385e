#include "server/api/kept_boards.h"

#include <gtest/gtest.h>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

std::string At(int64_t at) { return absl::StrCat("c/c/main/0/", at); }
KeptBoards::Text Text(size_t bytes) {
  return std::make_shared<const std::string>(bytes, 'x');
}

TEST(KeptBoards, IsStaleAfterAnyChange) {
  KeptBoards kept(4, 100);
  EXPECT_EQ(kept.Find(At(1), 7), nullptr);
  kept.Keep(At(1), 7, Text(3));
  EXPECT_NE(kept.Find(At(1), 7), nullptr);
  EXPECT_EQ(kept.Find(At(1), 8), nullptr);
  EXPECT_EQ(kept.Find("c/other/main/0/1", 7), nullptr) << "another config is in force";
  kept.Keep(At(1), 6, Text(5));
  EXPECT_EQ(kept.Find(At(1), 7)->size(), 3u) << "an older text does not replace a newer one";
  kept.Keep(At(2), -1, Text(5));
  EXPECT_EQ(kept.Find(At(2), -1), nullptr) << "nobody knows whether that one is stale";
}

TEST(KeptBoards, KeepsTheLastUsedOnes) {
  KeptBoards kept(2, 100);
  kept.Keep(At(1), 1, Text(1));
  kept.Keep(At(2), 1, Text(1));
  EXPECT_NE(kept.Find(At(1), 1), nullptr);
  kept.Keep(At(3), 1, Text(1));
  EXPECT_NE(kept.Find(At(1), 1), nullptr);
  EXPECT_EQ(kept.Find(At(2), 1), nullptr);
  EXPECT_NE(kept.Find(At(3), 1), nullptr);
}

TEST(KeptBoards, KeepsNoMoreBytesThanItMay) {
  KeptBoards kept(100, 10);
  for (int64_t at = 1; at <= 50; ++at) kept.Keep(At(at), 1, Text(4));
  EXPECT_EQ(kept.Find(At(48), 1), nullptr);
  EXPECT_NE(kept.Find(At(49), 1), nullptr);
  EXPECT_NE(kept.Find(At(50), 1), nullptr);
  kept.Keep(At(99), 1, Text(1000));
  EXPECT_EQ(kept.Find(At(50), 1), nullptr);
  EXPECT_NE(kept.Find(At(99), 1), nullptr) << "a board that is larger than all is kept alone";
  kept.Keep(At(99), 2, Text(2));
  kept.Keep(At(98), 2, Text(2));
  EXPECT_NE(kept.Find(At(99), 2), nullptr) << "the bytes of what was replaced count no more";
}

}  // namespace
}  // namespace myograde::server
