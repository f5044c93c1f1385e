#include "server/api/board_feeds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/api/views.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Json RowOf(const Json& rank, const std::string& team, int64_t evaluation) {
  return {{"rank", rank},
          {"team", team},
          {"evaluation", evaluation},
          {"name", "walker"},
          {"aggregate", {{"successes", 1}, {"episodes", 2}}}};
}

// A baseline stands first, and alpha has one beside its ranked row.
Json SomeBoard() {
  return {{"phase", nullptr},
          {"track", "manipulation"},
          {"board", "main"},
          {"config", "c"},
          {"rows", {RowOf(nullptr, "alpha", 1), RowOf(1, "beta", 2), RowOf(2, "alpha", 3)}}};
}

TEST(BoardFeeds, ABadgeCountsTheRankedTeams) {
  EXPECT_THAT(*DrawBadge(SomeBoard(), "beta"), HasSubstr("manipulation: rank 1 of 2"));
  EXPECT_THAT(*DrawBadge(SomeBoard(), "alpha"), HasSubstr("manipulation: rank 2 of 2"));
  Json board = SomeBoard();
  board["rows"].erase(2);
  EXPECT_THAT(*DrawBadge(board, "alpha"), HasSubstr("manipulation: baseline<"));
  EXPECT_FALSE(DrawBadge(board, "gamma").ok());
}

TEST(BoardFeeds, AFeedChangesWithTheBoardAndShowsRowsWhoseEndIsUnknown) {
  const std::string feed =
      WriteFeed(SomeBoard(), "2024-12-02T00:00:00.000Z",
                {{2, "2024-12-01T00:00:00.000Z"}, {3, "2024-11-30T00:00:00.000Z"}});
  EXPECT_THAT(feed, HasSubstr("</title><updated>2024-12-02T00:00:00.000Z"));
  EXPECT_THAT(feed, HasSubstr("<title>beta: rank 1</title><published>2024-12-01T00:00:00.000Z"
                              "</published><updated>2024-12-02T00:00:00.000Z</updated>"));
  EXPECT_THAT(feed, HasSubstr("<title>alpha: baseline</title><updated>2024-12-02"));
  EXPECT_THAT(WriteFeed(SomeBoard(), "x", {}), Not(HasSubstr("published")));
}

}  // namespace
}  // namespace myograde::server
