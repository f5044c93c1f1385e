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

TEST(ComputeVisibility, OrganisersSeeEverything) {
  for (const Role role : {Role::kOrganiser, Role::kOperator}) {
    EXPECT_TRUE(SeesAll(ComputeVisibility(role, {.shown = kNothing, .committed = true})));
  }
}

TEST(ComputeVisibility, OutsideOfPhasesNothingIsWithheld) {
  EXPECT_TRUE(SeesAll(ComputeVisibility(Role::kParticipant, {})));
}

TEST(ComputeVisibility, ParticipantsSeeWhatThePhaseShowsUntilItIsPublished) {
  const PhaseVisibility open = {.shown = kNothing};
  EXPECT_EQ(ComputeVisibility(Role::kParticipant, open), kNothing);
  EXPECT_TRUE(
      SeesAll(ComputeVisibility(Role::kParticipant, {.shown = kNothing, .published = true})));
  EXPECT_TRUE(
      SeesAll(ComputeVisibility(Role::kParticipant, {.shown = kNothing, .revealed = true})));
}

TEST(ComputeVisibility, CommittedSeedsStayHiddenUntilTheyAreRevealed) {
  for (const bool published : {false, true}) {
    PhaseVisibility phase = {.published = published, .committed = true};
    EXPECT_FALSE(ComputeVisibility(Role::kParticipant, phase).seeds);
    EXPECT_FALSE(SeesLogs(ComputeVisibility(Role::kParticipant, phase))) << "a log holds its seed";
    phase.revealed = true;
    EXPECT_TRUE(SeesAll(ComputeVisibility(Role::kParticipant, phase)));
  }
}

TEST(ComputeVisibility, NothingOfARunningLeaseIsShownWhileAnythingIsWithheldAndUnpublished) {
  EXPECT_TRUE(ComputeVisibility(Role::kParticipant, {}).progress);
  EXPECT_FALSE(ComputeVisibility(Role::kParticipant, {.shown = {.metrics = false}}).progress);
  EXPECT_FALSE(ComputeVisibility(Role::kParticipant, {.committed = true}).progress);
  EXPECT_TRUE(
      ComputeVisibility(Role::kParticipant, {.published = true, .committed = true}).progress);
}

TEST(ComputeVisibility, AFileCanNotShowCommittedSeeds) {
  EXPECT_FALSE(
      ComputeVisibility(Role::kParticipant, {.shown = {.seeds = true}, .committed = true}).seeds);
}

TEST(IsReplayPublic, OnlyWhereTheOrganiserAllowsIt) {
  EXPECT_TRUE(IsReplayPublic(true, {}));
  EXPECT_FALSE(IsReplayPublic(false, {}));
  EXPECT_FALSE(IsReplayPublic(false, {.published = true, .committed = true, .revealed = true}));
}

TEST(IsReplayPublic, NotWhileThePhaseWithholdsAPartOfIt) {
  EXPECT_TRUE(IsReplayPublic(true, {.shown = {.output = false}})) << "it has no output";
  for (const Visibility& shown : {Visibility{.aggregate = false}, Visibility{.outcomes = false},
                                  Visibility{.metrics = false}, Visibility{.logs = false}}) {
    EXPECT_FALSE(IsReplayPublic(true, {.shown = shown}));
    EXPECT_TRUE(IsReplayPublic(true, {.shown = shown, .published = true}));
  }
}

TEST(IsReplayPublic, NotWhileSeedsAreHidden) {
  PhaseVisibility phase = {.committed = true};
  EXPECT_FALSE(IsReplayPublic(true, phase));
  phase.published = true;
  EXPECT_FALSE(IsReplayPublic(true, phase));
  phase.revealed = true;
  EXPECT_TRUE(IsReplayPublic(true, phase));
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
