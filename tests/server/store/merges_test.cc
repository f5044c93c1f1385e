// A team that is merged into another one counts as that one, and no row of the past changes.
#include <set>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/store/people_fixture.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class MergesTest : public PeopleTest {};

TEST_F(MergesTest, AMergedTeamCountsAsTheOtherAndNoRowOfThePastChanges) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  ASSERT_TRUE(Found("beta", kBob).ok());
  const Accepted first = Submit("alpha", 'a');
  const Accepted second = Submit("beta", 'b');
  Play(first);
  Play(second);
  ASSERT_TRUE(TrySubmit("beta", 'e', /*ranked=*/true).ok());
  ASSERT_TRUE(Write([](Transaction& w) {
    return w.quotas.Grant({"beta", "manipulation", Budget::kRanked, 5, "a broken host"}, "uid 0");
  }).ok());
  const std::string history = History();
  const int64_t changes = BoardChanges();
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  EXPECT_EQ(History(), history);
  EXPECT_GT(BoardChanges(), changes);
  EXPECT_THAT(Board(), ElementsAre("alpha", "alpha"));
  const BudgetUse use = Quota("alpha").total_of(Budget::kRanked);
  EXPECT_EQ(use.charged, 2);
  EXPECT_EQ(use.open, 1);
  EXPECT_EQ(use.granted, 5);
  EXPECT_EQ(use.left(100), 100 + 5 - 2 - 1) << "the limit is there once";
  EXPECT_EQ(Quota("alpha").waiting, 1);
  EXPECT_EQ(TeamOf("beta"), "alpha");
  EXPECT_THAT(TeamsOf(kBob), ElementsAre("alpha"));
  EXPECT_THAT(ListMembers("alpha"), ElementsAre(kAda, kBob));
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.submissions.List({.team = "alpha"}).rows.size(), 3u);
    EXPECT_EQ(reader.teams.Find("alpha")->submissions, 3);
    EXPECT_EQ(reader.quotas.Ledger("alpha", "", INT64_MAX, 10).rows.size(), 3u);
    EXPECT_THAT(reader.teams.Find("beta")->other_names, ElementsAre("beta"));
    const std::vector<TeamRow> teams = reader.teams.List().rows;
    ASSERT_EQ(teams.size(), 2u);
    EXPECT_EQ(teams[0].merged_into, "alpha");
    EXPECT_THAT(teams[0].members, IsEmpty());
    EXPECT_THAT(teams[1].members, ElementsAre(kAda, kBob));
    const Listed<TeamRow> page = reader.teams.List(teams[0].id, 1);
    ASSERT_EQ(page.rows.size(), 1u);
    EXPECT_EQ(page.last_id, teams[1].id);
    EXPECT_THAT(page.rows[0].members, ElementsAre(kAda, kBob));
  });
  // Its ranked evaluations are those of the other as well.
  const absl::StatusOr<Accepted> again = TrySubmit("alpha", 'b', /*ranked=*/true);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_EQ(again->submission, second.submission);
  ASSERT_TRUE(SetMember("beta", kBob, false).ok());
  EXPECT_THAT(TeamsOf(kBob), IsEmpty());
}

TEST_F(MergesTest, OfTheChoicesOfMergedTeamsTheNewerStands) {
  const Accepted first = Submit("alpha", 'a');
  const Accepted second = Submit("beta", 'b');
  Play(first);
  Play(second);
  const auto choose = [&](const Accepted& accepted) {
    bool changed = false;
    EXPECT_TRUE(Write([&](Transaction& w) {
      const absl::StatusOr<bool> done = w.journal.Choose(accepted.submission, kAda);
      changed = done.value_or(false);
      return done.status();
    }).ok());
    return changed;
  };
  const auto choices = [&] {
    std::set<int64_t> chosen;
    Read([&](const Transaction& reader) { chosen = reader.Board().Chosen(std::string(64, 'c')); });
    return chosen;
  };
  EXPECT_TRUE(choose(second));
  EXPECT_TRUE(choose(first));
  EXPECT_THAT(choices(), ElementsAre(first.submission, second.submission));
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  EXPECT_THAT(choices(), ElementsAre(first.submission));
  EXPECT_TRUE(choose(second)) << "though it is the newest of its own team's";
  EXPECT_THAT(choices(), ElementsAre(second.submission));
  EXPECT_FALSE(choose(second));
}

TEST_F(MergesTest, AMergeIsRefusedInOneSentence) {
  for (const char* team : {"alpha", "beta", "gamma", "delta"}) ASSERT_TRUE(Create(team).ok());
  EXPECT_THAT(Sentence(Merge("alpha", "alpha")), HasSubstr("can't be merged into itself"));
  EXPECT_THAT(Sentence(Merge("nobody", "alpha")), HasSubstr("there is no team \"nobody\""));
  ASSERT_TRUE(Rename("alpha", "aleph").ok());
  EXPECT_THAT(Sentence(Merge("alpha", "aleph")), HasSubstr("can't be merged into itself"));
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  for (const absl::Status& refused :
       {Merge("beta", "aleph"), Merge("beta", "gamma"), Merge("gamma", "beta"),
        Merge("aleph", "beta")}) {
    EXPECT_TRUE(absl::IsFailedPrecondition(refused));
    EXPECT_THAT(Sentence(refused), HasSubstr("team \"beta\" was merged into team \"aleph\""));
  }
  ASSERT_TRUE(Ban("delta").ok());
  EXPECT_THAT(Sentence(Merge("delta", "gamma")), HasSubstr("\"delta\" is banned"));
  EXPECT_THAT(Sentence(Merge("gamma", "delta")), HasSubstr("\"delta\" is banned"));
  EXPECT_THAT(Sentence(Rename("aleph", "beta")), HasSubstr("the name of a team that was merged"));
  Read([&](const Transaction& reader) {
    EXPECT_FALSE(reader.teams.CheckMerge("beta", "gamma").ok());
    EXPECT_TRUE(reader.teams.CheckMerge("alpha", "gamma").ok());
  });
  // A chain ends at the last of them.
  ASSERT_TRUE(Merge("alpha", "gamma").ok());
  for (const char* name : {"alpha", "aleph", "beta"}) EXPECT_EQ(TeamOf(name), "gamma");
}

}  // namespace
}  // namespace myograde::server
