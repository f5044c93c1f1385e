#include "server/access/identity.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <string>
#include <vector>

namespace myograde::server {
namespace {

using Teams = std::set<std::string>;

constexpr bool kChallenge = true;
constexpr bool kLocal = false;
constexpr int64_t kNow = 1'700'000'000'000;

HostUser User(uid_t uid, std::vector<gid_t> groups = {}) { return {uid, std::move(groups), false}; }

UserRule OfUid(uid_t uid, Role role, std::string team = "") {
  UserRule rule;
  rule.uid = uid;
  rule.role = role;
  rule.team = std::move(team);
  return rule;
}

UserRule OfGid(gid_t gid, Role role, std::string team = "") {
  UserRule rule;
  rule.gid = gid;
  rule.role = role;
  rule.team = std::move(team);
  return rule;
}

TEST(IdentityTest, TheOwnerIsAnOperatorWhateverTheSettingsSay) {
  const HostUser owner{0, {}, true};
  const AccessConfig config = {{OfUid(0, Role::kParticipant, "alpha")}, 1};
  for (const bool challenge : {kChallenge, kLocal}) {
    EXPECT_EQ(IdentityOfUser(owner, config, {}, challenge).role, Role::kOperator);
  }
}

TEST(IdentityTest, InAChallengeAnUnknownUserIsNobody) {
  const Identity identity = IdentityOfUser(User(1000), {}, {}, kChallenge);
  EXPECT_EQ(identity.role, Role::kPublic);
  EXPECT_EQ(identity.key, "uid 1000");
  EXPECT_FALSE(identity.may_found_team);
  EXPECT_FALSE(identity.remote);
}

TEST(IdentityTest, WithoutAChallengeEverybodyTakesPart) {
  const Identity identity = IdentityOfUser(User(1000), {}, {}, kLocal);
  EXPECT_EQ(identity.role, Role::kParticipant);
  EXPECT_TRUE(identity.teams.empty());
  EXPECT_TRUE(identity.may_found_team);
}

TEST(IdentityTest, AMemberIsAParticipantOfTheirTeams) {
  const Identity identity = IdentityOfUser(User(1000), {}, {"alpha", "beta"}, kChallenge);
  EXPECT_EQ(identity.role, Role::kParticipant);
  EXPECT_EQ(identity.teams, (Teams{"alpha", "beta"}));
}

TEST(IdentityTest, OfSeveralRulesTheHighestRoleAndAllTeamsCount) {
  const AccessConfig config = {{OfGid(50, Role::kParticipant, "lab"),
                                OfUid(1000, Role::kOrganiser),
                                OfUid(1000, Role::kParticipant, "alpha"),
                                OfUid(1001, Role::kOperator)},
                               1};
  const Identity identity = IdentityOfUser(User(1000, {7, 50}), config, {"own"}, kChallenge);
  EXPECT_EQ(identity.role, Role::kOrganiser);
  EXPECT_EQ(identity.teams, (Teams{"alpha", "lab", "own"}));
  EXPECT_EQ(IdentityOfUser(User(1000, {7}), config, {}, kChallenge).teams, Teams{"alpha"});
  EXPECT_EQ(IdentityOfUser(User(1002, {50}), config, {}, kChallenge).role, Role::kParticipant);
  EXPECT_EQ(IdentityOfUser(User(1001), config, {}, kChallenge).role, Role::kOperator);
}

// A rule whose name was not resolved fits nobody, nor does a uid fit a gid of the same number.
TEST(IdentityTest, ARuleFitsWhomItNamesOnly) {
  UserRule unresolved;
  unresolved.user = "ada";
  unresolved.role = Role::kOperator;
  const AccessConfig config = {{unresolved, OfGid(1000, Role::kOperator)}, 1};
  EXPECT_EQ(RuledRole(User(1000, {7}), config), Role::kPublic);
}

TEST(IdentityTest, AnAddressWithoutATokenIsNobody) {
  const Identity identity = IdentityOfAddress("address 192.0.2.1");
  EXPECT_EQ(identity.role, Role::kPublic);
  EXPECT_TRUE(identity.remote);
  EXPECT_TRUE(identity.teams.empty());
  EXPECT_FALSE(identity.may_found_team);
}

TokenRow Token(const std::string& role, const std::string& team = "") {
  TokenRow row;
  row.id = 7;
  row.role = role;
  row.team = team;
  row.created_at = kNow - 1000;
  return row;
}

TokenProblem FindProblem(const std::optional<TokenRow>& row) {
  const auto identity = IdentityOfToken(row, kNow, /*remote=*/true);
  EXPECT_TRUE(std::holds_alternative<TokenProblem>(identity));
  return std::get<TokenProblem>(identity);
}

TEST(IdentityTest, ATokenSaysRoleAndTeam) {
  const auto identity =
      std::get<Identity>(IdentityOfToken(Token("participant", "alpha"), kNow, /*remote=*/true));
  EXPECT_EQ(identity.role, Role::kParticipant);
  EXPECT_EQ(identity.key, "token 7");
  EXPECT_EQ(identity.token, 7);
  EXPECT_EQ(identity.teams, Teams{"alpha"});
  EXPECT_TRUE(identity.remote);
  EXPECT_FALSE(identity.may_found_team);
}

TEST(IdentityTest, ATokenEndsWithTheMillisecondOfItsExpiry) {
  TokenRow row = Token("organiser");
  row.expires_at = kNow + 1;
  EXPECT_TRUE(std::holds_alternative<Identity>(IdentityOfToken(row, kNow, true)));
  row.expires_at = kNow;
  EXPECT_EQ(FindProblem(row), TokenProblem::kExpired);
  row.revoked_at = kNow - 5;
  EXPECT_EQ(FindProblem(row), TokenProblem::kRevoked);
}

TEST(IdentityTest, NoRowAndNoSuchRoleAreUnknown) {
  EXPECT_EQ(FindProblem(std::nullopt), TokenProblem::kUnknown);
  EXPECT_EQ(FindProblem(Token("root")), TokenProblem::kUnknown);
}

TEST(IdentityTest, AnAuthorizationIsAWordAndAToken) {
  const std::string token = "myo_" + std::string(64, 'a');
  for (const char* scheme : {"Bearer ", "bearer ", "BEARER   "}) {
    EXPECT_EQ(TokenIn(scheme + token), token) << scheme;
  }
  for (const std::string& wrong :
       {std::string(), std::string("Bearer"), std::string("Bearer "), token, "Basic " + token,
        "Bearer" + token, "Bearer " + token + " ", "Bearer " + token + "a", "Bearer x" + token,
        "Bearer " + token.substr(1), "Bearer\t" + token, "Bearers " + token,
        "Bearer myo_" + std::string(64, 'g'), "Bearer " + std::string(9000, 'a')}) {
    EXPECT_FALSE(TokenIn(wrong).has_value()) << wrong;
  }
}

RC_GTEST_PROP(IdentityProperties, NoTextBreaksTheReadingOfATokenOrBecomesOne,
              (const std::string& text)) {
  const auto token = TokenIn(text);
  if (token.has_value()) RC_ASSERT(token->starts_with("myo_") && text.ends_with(*token));
}

// Rules and memberships only ever add: nobody loses a right by one more of them.
RC_GTEST_PROP(IdentityProperties, ARuleMoreNeverTakesAway, ()) {
  const auto any_role = rc::gen::element(Role::kParticipant, Role::kOrganiser, Role::kOperator);
  AccessConfig config;
  for (int i = *rc::gen::inRange(0, 4); i > 0; --i) {
    const Role role = *any_role;
    const std::string team = role == Role::kParticipant ? *rc::gen::element<std::string>("a", "b")
                                                        : "";
    config.users.push_back(*rc::gen::arbitrary<bool>()
                               ? OfUid(*rc::gen::inRange<uid_t>(1, 4), role, team)
                               : OfGid(*rc::gen::inRange<gid_t>(1, 4), role, team));
  }
  const HostUser user = User(*rc::gen::inRange<uid_t>(1, 4), {*rc::gen::inRange<gid_t>(1, 4)});
  const bool challenge = *rc::gen::arbitrary<bool>();
  const Identity before = IdentityOfUser(user, config, {}, challenge);
  config.users.push_back(OfUid(*rc::gen::inRange<uid_t>(1, 4), *any_role));
  const Identity after = IdentityOfUser(user, config, {"member"}, challenge);
  RC_ASSERT(after.role >= before.role);
  for (const std::string& team : before.teams) RC_ASSERT(after.teams.contains(team));
}

}  // namespace
}  // namespace myograde::server
