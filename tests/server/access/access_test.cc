#include "server/access/access.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <set>
#include <string>
#include <vector>

namespace myograde::server {
namespace {

const std::vector<std::string> kTeams = {"alpha", "beta", "gamma"};
const std::vector<Role> kRoles = {Role::kPublic, Role::kParticipant, Role::kOrganiser,
                                  Role::kOperator};

Identity AnyIdentity() {
  Identity identity;
  identity.role = *rc::gen::elementOf(kRoles);
  identity.key = "uid 7";
  for (const std::string& team : kTeams) {
    if (*rc::gen::arbitrary<bool>()) identity.teams.insert(team);
  }
  identity.remote = *rc::gen::arbitrary<bool>();
  identity.may_found_team = *rc::gen::arbitrary<bool>();
  return identity;
}

Action AnyAction() {
  const auto actions = AllActions();
  return actions[*rc::gen::inRange<size_t>(0, actions.size())];
}

TEST(AccessTest, EveryRoleHasANameOfItsOwn) {
  for (const Role role : kRoles) EXPECT_EQ(ParseRole(RoleName(role)), role);
  EXPECT_FALSE(ParseRole("root").has_value());
  EXPECT_FALSE(ParseRole("").has_value());
}

TEST(AccessTest, EveryActionHasANameOfItsOwn) {
  std::set<std::string_view> names;
  for (const Action action : AllActions()) names.insert(ActionName(action));
  EXPECT_EQ(names.size(), AllActions().size());
}

// What must never be everybody's or every participant's, whatever else changes.
TEST(AccessTest, WhatChangesOthersThingsIsNotForParticipants) {
  for (const Action action : {Action::kMark, Action::kGrant, Action::kRebuildBoards,
                              Action::kExport, Action::kManageTeams, Action::kManageTokens,
                              Action::kManagePhases, Action::kReadEvents, Action::kReadHost,
                              Action::kReadMetrics}) {
    EXPECT_EQ(RoleFor(action), Role::kOrganiser) << ActionName(action);
  }
  for (const Action action : {Action::kImport, Action::kBackup, Action::kManageOperators,
                              Action::kManageWebhooks, Action::kManageNodes}) {
    EXPECT_EQ(RoleFor(action), Role::kOperator) << ActionName(action);
  }
}

TEST(AccessTest, AScrapersTokenReadsTheMetricsAndNothingElse) {
  Identity scraper;
  scraper.scraper = true;
  for (const Action action : AllActions()) {
    const bool open = action == Action::kReadMetrics || RoleFor(action) == Role::kPublic;
    EXPECT_EQ(Decide(scraper, action, std::nullopt) == Access::kAllowed, open)
        << ActionName(action);
  }
}

TEST(AccessTest, WhatBelongsToATeamIsForNobodyWithoutOne) {
  for (const Action action : AllActions()) {
    if (NeedsTeam(action)) {
      EXPECT_EQ(RoleFor(action), Role::kParticipant) << ActionName(action);
    }
  }
}

RC_GTEST_PROP(AccessProperties, ARoleMayDoWhateverALesserOneMay, ()) {
  Identity lesser = AnyIdentity();
  Identity greater = lesser;
  greater.role = *rc::gen::suchThat(rc::gen::elementOf(kRoles),
                                    [&](Role role) { return role >= lesser.role; });
  const Action action = AnyAction();
  const std::string team = *rc::gen::elementOf(kTeams);
  if (Decide(lesser, action, team) == Access::kAllowed) {
    RC_ASSERT(Decide(greater, action, team) == Access::kAllowed);
  }
  if (Decide(lesser, action, std::nullopt) == Access::kAllowed) {
    RC_ASSERT(Decide(greater, action, std::nullopt) == Access::kAllowed);
  }
}

RC_GTEST_PROP(AccessProperties, NobodyActsForATeamThatIsNotTheirs, ()) {
  Identity identity = AnyIdentity();
  identity.role = *rc::gen::element(Role::kPublic, Role::kParticipant);
  const std::string team = *rc::gen::elementOf(kTeams);
  identity.teams.erase(team);
  for (const Action action : AllActions()) {
    if (NeedsTeam(action)) RC_ASSERT(Decide(identity, action, team) != Access::kAllowed);
  }
}

RC_GTEST_PROP(AccessProperties, AnOwnTeamIsNeverHiddenFromItsParticipants, ()) {
  Identity identity = AnyIdentity();
  identity.role = Role::kParticipant;
  const std::string team = *rc::gen::elementOf(kTeams);
  identity.teams.insert(team);
  const Action action = AnyAction();
  RC_ASSERT(Decide(identity, action, team) != Access::kUnknown);
}

// Whether something exists is told to those only whose role allows the action at all, and the role
// decides alike for what exists and what does not.
RC_GTEST_PROP(AccessProperties, TheRoleDecidesBeforeTheTeam, ()) {
  const Identity identity = AnyIdentity();
  const Action action = AnyAction();
  const std::string team = *rc::gen::elementOf(kTeams);
  const bool forbidden = Decide(identity, action, std::nullopt) == Access::kForbidden;
  RC_ASSERT(forbidden == (identity.role < RoleFor(action)));
  RC_ASSERT(forbidden == (Decide(identity, action, team) == Access::kForbidden));
}

}  // namespace
}  // namespace myograde::server
