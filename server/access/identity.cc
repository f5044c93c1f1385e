#include "server/access/identity.h"

#include <algorithm>

#include <absl/strings/escaping.h>
#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"
#include "server/base/secret.h"

namespace myograde::server {
namespace {

constexpr std::string_view kPrefix = "myo_";
constexpr size_t kRandomBytes = 32;

bool Fits(const UserRule& rule, const HostUser& user) {
  if (rule.uid.has_value()) return *rule.uid == user.uid;
  return rule.gid.has_value() &&
         std::find(user.groups.begin(), user.groups.end(), *rule.gid) != user.groups.end();
}

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
                        const std::set<std::string>& member_of, bool challenge) {
  Identity identity;
  identity.key = PeerKey(user.uid);
  identity.role = RuledRole(user, config);
  identity.teams = member_of;
  for (const UserRule& rule : config.users) {
    if (Fits(rule, user) && !rule.team.empty()) identity.teams.insert(rule.team);
  }
  const bool takes_part = !challenge || !identity.teams.empty();
  if (takes_part) identity.role = std::max(identity.role, Role::kParticipant);
  identity.may_found_team = !challenge;
  return identity;
}

Identity IdentityOfAddress(const std::string& key) {
  return {.key = key, .teams = {}, .remote = true};
}

std::variant<Identity, TokenProblem> IdentityOfToken(const std::optional<TokenRow>& row,
                                                     int64_t now_ms, bool remote) {
  if (!row.has_value()) return TokenProblem::kUnknown;
  const std::optional<Role> role = ParseRole(row->role);
  if (!role.has_value()) return TokenProblem::kUnknown;
  if (row->revoked_at != 0) return TokenProblem::kRevoked;
  if (row->expires_at != 0 && now_ms >= row->expires_at) return TokenProblem::kExpired;
  std::set<std::string> teams;
  if (!row->team.empty()) teams.insert(row->team);
  return Identity{.role = *role,
                  .key = absl::StrCat("token ", row->id),
                  .teams = std::move(teams),
                  .remote = remote,
                  .token = row->id};
}

absl::StatusOr<std::string> NewTokenText() {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(kRandomBytes));
  return absl::StrCat(std::string(kPrefix), absl::BytesToHexString(bytes));
}

std::string TokenHash(std::string_view text) { return Sha256Hex(std::string(text)); }

std::optional<std::string_view> TokenIn(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  const std::string_view scheme = authorization.substr(0, kScheme.size());
  if (!absl::EqualsIgnoreCase({scheme.data(), scheme.size()}, {kScheme.data(), kScheme.size()})) {
    return std::nullopt;
  }
  std::string_view token = authorization.substr(scheme.size());
  token.remove_prefix(std::min(token.find_first_not_of(' '), token.size()));
  if (!token.starts_with(kPrefix)) return std::nullopt;
  const std::string_view digits = token.substr(kPrefix.size());
  const bool good = digits.size() == 2 * kRandomBytes &&
                    digits.find_first_not_of("0123456789abcdef") == std::string_view::npos;
  return good ? std::optional(token) : std::nullopt;
}

}  // namespace myograde::server
