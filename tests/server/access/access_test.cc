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

std::vector<Action> AllActions() {
  std::vector<Action> actions;
  for (int i = 0; i <= static_cast<int>(Action::kManageNodes); ++i) actions.push_back(Action(i));
  return actions;
}

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
    EXPECT_EQ(MayTake(scraper, action, std::nullopt), open) << ActionName(action);
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
  RC_ASSERT(!MayTake(lesser, action, team) || MayTake(greater, action, team));
  RC_ASSERT(!MayTake(lesser, action, std::nullopt) || MayTake(greater, action, std::nullopt));
}

RC_GTEST_PROP(AccessProperties, NobodyActsForATeamThatIsNotTheirs, ()) {
  Identity identity = AnyIdentity();
  identity.role = *rc::gen::element(Role::kPublic, Role::kParticipant);
  const std::string team = *rc::gen::elementOf(kTeams);
  identity.teams.erase(team);
  for (const Action action : AllActions()) {
    if (NeedsTeam(action)) RC_ASSERT(!MayTake(identity, action, team));
  }
}

RC_GTEST_PROP(AccessProperties, AnOwnTeamIsNeverHiddenFromItsParticipants, ()) {
  Identity identity = AnyIdentity();
  identity.role = Role::kParticipant;
  const std::string team = *rc::gen::elementOf(kTeams);
  identity.teams.insert(team);
  const Action action = AnyAction();
  RC_ASSERT(MayTake(identity, action, team) == MayTake(identity, action, std::nullopt));
}

// Whether something exists is told to those only whose role allows the action at all.
RC_GTEST_PROP(AccessProperties, TheRoleDecidesBeforeTheTeam, ()) {
  const Identity identity = AnyIdentity();
  const Action action = AnyAction();
  const std::string team = *rc::gen::elementOf(kTeams);
  RC_ASSERT(MayTake(identity, action, std::nullopt) == (identity.role >= RoleFor(action)));
  RC_ASSERT(!MayTake(identity, action, team) || MayTake(identity, action, std::nullopt));
}

}  // namespace
}  // namespace myograde::server
