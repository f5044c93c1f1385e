// Who sees what of a phase's evaluations.
#include "server/access/access.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr Visibility kNothing = {.aggregate = false,
                                 .outcomes = false,
                                 .metrics = false,
                                 .logs = false,
                                 .output = false,
                                 .seeds = true,
                                 .progress = false};

TEST(SightOf, OrganisersSeeEverything) {
  for (const Role role : {Role::kOrganiser, Role::kOperator}) {
    EXPECT_TRUE(SeesAll(VisibilityOf(role, {.shown = kNothing, .committed = true})));
  }
}

TEST(SightOf, OutsideOfPhasesNothingIsWithheld) {
  EXPECT_TRUE(SeesAll(VisibilityOf(Role::kParticipant, {})));
}

TEST(SightOf, ParticipantsSeeWhatThePhaseShowsUntilItIsPublished) {
  const PhaseVisibility open = {.shown = kNothing};
  EXPECT_EQ(VisibilityOf(Role::kParticipant, open), kNothing);
  EXPECT_TRUE(SeesAll(VisibilityOf(Role::kParticipant, {.shown = kNothing, .published = true})));
  EXPECT_TRUE(SeesAll(VisibilityOf(Role::kParticipant, {.shown = kNothing, .revealed = true})));
}

TEST(SightOf, CommittedSeedsStayHiddenUntilTheyAreRevealed) {
  for (const bool published : {false, true}) {
    PhaseVisibility phase = {.published = published, .committed = true};
    EXPECT_FALSE(VisibilityOf(Role::kParticipant, phase).seeds);
    EXPECT_FALSE(SeesLogs(VisibilityOf(Role::kParticipant, phase))) << "a log holds its seed";
    phase.revealed = true;
    EXPECT_TRUE(SeesAll(VisibilityOf(Role::kParticipant, phase)));
  }
}

TEST(SightOf, NothingOfARunningLeaseIsShownWhileAnythingIsWithheldAndUnpublished) {
  EXPECT_TRUE(VisibilityOf(Role::kParticipant, {}).progress);
  EXPECT_FALSE(VisibilityOf(Role::kParticipant, {.shown = {.metrics = false}}).progress);
  EXPECT_FALSE(VisibilityOf(Role::kParticipant, {.committed = true}).progress);
  EXPECT_TRUE(VisibilityOf(Role::kParticipant, {.published = true, .committed = true}).progress);
}

TEST(SightOf, AFileCanNotShowCommittedSeeds) {
  EXPECT_FALSE(VisibilityOf(Role::kParticipant, {.shown = {.seeds = true}, .committed = true}).seeds);
}

TEST(WithheldParts, AreNamedInOrder) {
  EXPECT_THAT(WithheldParts({}), IsEmpty());
  EXPECT_THAT(WithheldParts({.metrics = false, .seeds = false}), ElementsAre("metrics", "seeds"));
  EXPECT_THAT(WithheldParts(kUnknownPhaseVisibility),
              ElementsAre("outcomes", "metrics", "logs", "output", "seeds"));
}

TEST(SeesReceipt, NeedsOutcomesAndMetrics) {
  EXPECT_TRUE(SeesReceipt({.logs = false, .output = false, .seeds = false}));
  EXPECT_FALSE(SeesReceipt({.outcomes = false}));
  EXPECT_FALSE(SeesReceipt({.metrics = false}));
}

}  // namespace
}  // namespace myograde::server
