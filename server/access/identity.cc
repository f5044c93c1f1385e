#include "server/access/identity.h"

#include <algorithm>

#include "server/access/token_text.h"
#include "server/base/peer_key.h"

namespace myograde::server {
namespace {

constexpr std::string_view kScheme = "bearer";

bool Fits(const UserRule& rule, const HostUser& user) {
  if (rule.uid.has_value()) return *rule.uid == user.uid;
  return rule.gid.has_value() && std::find(user.groups.begin(), user.groups.end(), *rule.gid) !=
                                     user.groups.end();
}

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

}  // namespace

Role RuledRole(const HostUser& user, const AccessConfig& config) {
  if (user.owner) return Role::kOperator;
  Role role = Role::kPublic;
  for (const UserRule& rule : config.users) {
    if (Fits(rule, user)) role = std::max(role, rule.role);
  }
  return role;
}

Identity IdentityOfUser(const HostUser& user, const AccessConfig& config,
                        const std::vector<std::string>& member_of, bool challenge) {
  Identity identity;
  identity.key = PeerKey(user.uid);
  identity.role = RuledRole(user, config);
  identity.teams.insert(member_of.begin(), member_of.end());
  for (const UserRule& rule : config.users) {
    if (Fits(rule, user) && !rule.team.empty()) identity.teams.insert(rule.team);
  }
  const bool takes_part = !challenge || !identity.teams.empty();
  if (takes_part) identity.role = std::max(identity.role, Role::kParticipant);
  identity.may_found_team = !challenge;
  return identity;
}

Identity IdentityOfAddress(const std::string& key) {
  Identity identity;
  identity.key = key;
  identity.remote = true;
  return identity;
}

std::variant<Identity, TokenProblem> IdentityOfToken(const std::optional<TokenRow>& row,
                                                     int64_t now_ms, bool remote) {
  if (!row.has_value()) return TokenProblem::kUnknown;
  const std::optional<Role> role = ParseRole(row->role);
  if (!role.has_value()) return TokenProblem::kUnknown;
  if (row->revoked_at != 0) return TokenProblem::kRevoked;
  if (row->expires_at != 0 && now_ms >= row->expires_at) return TokenProblem::kExpired;
  Identity identity;
  identity.role = *role;
  identity.key = "token " + std::to_string(row->id);
  identity.token = row->id;
  if (!row->team.empty()) identity.teams.insert(row->team);
  identity.remote = remote;
  return identity;
}

std::optional<std::string_view> TokenIn(std::string_view authorization) {
  const size_t space = authorization.find(' ');
  if (space != kScheme.size() ||
      !std::equal(kScheme.begin(), kScheme.end(), authorization.begin(),
                  [](char wanted, char given) { return wanted == Lower(given); })) {
    return std::nullopt;
  }
  std::string_view token = authorization.substr(space);
  token.remove_prefix(std::min(token.find_first_not_of(' '), token.size()));
  if (!IsTokenText(token)) return std::nullopt;
  return token;
}

}  // namespace myograde::server
