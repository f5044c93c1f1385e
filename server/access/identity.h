// Who a request comes from, as a function of what the connection, the settings, the store and a
// bearer token say. Pure. Tokens are texts of "myo_" and 64 hexadecimal digits; only their hashes
// are kept.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <absl/status/statusor.h>

#include "server/access/access.h"
#include "server/store/rows.h"

namespace myograde::server {

// A user of this host, at the other end of the Unix socket.
struct HostUser {
  uid_t uid = 0;
  std::vector<gid_t> groups;
  bool owner = false;  // root, or the user that runs the daemon
};

// What the settings alone say about a user: public if nothing. Of several rules that fit, the
// highest role counts, and all teams.
Role RuledRole(const HostUser& user, const AccessConfig& config);

// `member_of`: the teams of the user's member rows. `challenge`: whether there is a challenge;
// without one, every user of this host is at least a participant and may found a team.
Identity IdentityOfUser(const HostUser& user, const AccessConfig& config,
                        const std::set<std::string>& member_of, bool challenge);

// Somebody without a token, at a network address.
Identity IdentityOfAddress(const std::string& key);

// Why a token is not accepted.
enum class TokenProblem { kUnknown, kExpired, kRevoked };

// The holder of a token. `row`: of the store, by the hash of the token's text; nullopt: none.
std::variant<Identity, TokenProblem> IdentityOfToken(const std::optional<TokenRow>& row,
                                                     int64_t now_ms, bool remote);

// A new token of 256 random bits. InternalError: the host has no random numbers.
absl::StatusOr<std::string> NewTokenText();

// What the store knows a token by: the text's SHA-256, in lower-case hexadecimal. Finding it by an
// index leaks nothing through the time that this takes, as nobody can choose a hash's digits
// without the text.
std::string TokenHash(std::string_view text);

// The token in an Authorization header ("Bearer myo_..."), which has a token's form but need not be
// valid; nullopt: the header has another form.
std::optional<std::string_view> TokenIn(std::string_view authorization);

}  // namespace myograde::server
