#include "server/api/guard.h"

#include <algorithm>
#include <set>
#include <utility>
#include <variant>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>

#include "server/api/routes.h"
#include "server/base/peer_key.h"

namespace myograde::server {
namespace {

// Callers that limits remember at the same time.
constexpr size_t kMostKeys = 10'000;
constexpr absl::Duration kTouchEvery = absl::Minutes(1);

HostUser UserOf(const Peer& peer) {
  return {peer.uid, peer.groups, IsOrganiser(PeerKey(peer.uid))};
}

ApiError TooMany(const char* what, absl::Duration wait) {
  const int64_t seconds = absl::ToInt64Seconds(absl::Ceil(wait, absl::Seconds(1)));
  return {429, "too_many", absl::StrCat("too many ", what, "; try again in ", seconds, " s"),
          seconds};
}

std::string DayOf(int64_t ms) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::FromUnixMillis(ms), absl::UTCTimeZone());
}

// For those whose role is too low.
ApiError Forbidden(const Identity& identity, Action action) {
  if (identity.remote && identity.role == Role::kPublic) {
    return {401, "no_token",
            "this needs a token, in the header \"Authorization: Bearer TOKEN\"; ask an organiser "
            "for one"};
  }
  switch (RoleFor(action)) {
    case Role::kOperator:
      return {403, "forbidden",
              "only operators may do this: root, the user that runs the daemon, and others whom "
              "server.json or a token makes operators"};
    case Role::kOrganiser:
      return {403, "forbidden", "only organisers may do this"};
    default:
      return {403, "forbidden",
              "only members of a team may do this; ask an organiser to add you to yours"};
  }
}

}  // namespace

Guard::Guard(const ApiContext& context)
    : context_(context),
      requests_(context.config.http.requests_per_s, context.config.http.burst, kMostKeys),
      wrong_tokens_(kMostKeys),
      good_tokens_(kMostKeys) {}

std::optional<ApiError> Guard::Admit(Connection& connection, Action action, Identity& who) {
  if (auto refusal = Identify(connection.Asker(), *connection.head, action, who)) return refusal;
  if (!connection.admitted) {
    if (std::optional<ApiError> over = Count(who)) {
      context_.access_log.Deny(who, action, "too many requests");
      return over;
    }
    connection.admitted = true;
  }
  if (MayTake(who, action, std::nullopt)) return std::nullopt;
  context_.access_log.Deny(who, action, "role");
  return Forbidden(who, action);
}

std::optional<ApiError> Guard::AdmitBody(Connection& connection, const Router& router) {
  const Request& head = *connection.head;
  const Address* address = router.Find(head);
  if (address == nullptr) {
    // Nothing takes it, so nobody's connection is held until it is there.
    if (!connection.Asker().network) return std::nullopt;
    if (std::optional<ApiError> over = AdmitUnknown(connection)) return over;
    if (head.method == "OPTIONS") return std::nullopt;
    return router.WhyNone(head);
  }
  Identity who;
  if (auto refusal = Admit(connection, address->action, who)) return refusal;
  return TakeUpload(connection, who);
}

std::optional<ApiError> Guard::TakeUpload(Connection& connection, const Identity& identity) {
  if (!identity.remote || identity.role >= Role::kOrganiser) return std::nullopt;
  const std::string whose = identity.teams.empty() ? identity.key : *identity.teams.begin();
  const MutexLock lock(uploads_->mutex);
  int& count = uploads_->of[whose];
  if (count >= std::max(context_.config.http.address_clients / 2, 1)) {
    return ApiError{429, "too_many",
                    "your team has too many uploads at once; let some of them end first"};
  }
  ++count;
  connection.upload = std::shared_ptr<void>(nullptr, [uploads = uploads_, whose](void*) {
    const MutexLock own(uploads->mutex);
    if (--uploads->of[whose] == 0) uploads->of.erase(whose);
  });
  return std::nullopt;
}

std::optional<ApiError> Guard::AdmitUnknown(Connection& connection) {
  Identity who;
  if (auto refusal = Identify(connection.Asker(), *connection.head, std::nullopt, who)) {
    return refusal;
  }
  return connection.admitted ? std::nullopt : Count(who);
}

std::optional<ApiError> Guard::Identify(const Peer& peer, const Request& head,
                                        std::optional<Action> action, Identity& who) {
  if (head.authorization.has_value()) {
    return IdentifyToken(peer, *head.authorization, action.value_or(Action::kReadApi), who);
  }
  if (!peer.network) return IdentifyUser(peer, action, who);
  who = IdentityOfAddress(peer.key);
  return std::nullopt;
}

std::optional<ApiError> Guard::IdentifyUser(const Peer& peer, std::optional<Action> action,
                                            Identity& who) {
  const auto identify = [&](const std::set<std::string>& member_of) {
    return IdentityOfUser(UserOf(peer), context_.config.access, member_of, context_.challenge);
  };
  who = identify({});
  if (!action.has_value() || who.role >= Role::kOrganiser) return std::nullopt;
  const absl::Status status = context_.readers.Read([&](const Transaction& reader) {
    who = identify(reader.teams.OfPerson(who.key));
    std::set<std::string> named;
    for (const std::string& team : who.teams) named.insert(reader.teams.NameOf(team));
    who.teams = std::move(named);
    return absl::OkStatus();
  });
  // What is open to everybody is answered also while the store is in trouble.
  if (!status.ok() && RoleFor(*action) > Role::kPublic) return ToApiError(status);
  return std::nullopt;
}

std::optional<ApiError> Guard::IdentifyToken(const Peer& peer, std::string_view authorization,
                                             Action action, Identity& who) {
  const std::optional<std::string_view> token = TokenIn(authorization);
  constexpr std::string_view kBearer = "Bearer ";
  // Only hashes are compared, so the time that this takes tells nothing of the token.
  const bool scrapes =
      action == Action::kReadMetrics && !context_.metrics_token.empty() &&
      authorization.starts_with(kBearer) &&
      TokenHash(authorization.substr(kBearer.size())) == context_.metrics_token;
  const std::string hash = scrapes             ? context_.metrics_token
                           : token.has_value() ? TokenHash(*token)
                                               : "";
  if (std::optional<ApiError> wait = CheckTries(peer, hash)) return wait;
  if (scrapes) {
    who = IdentityOfAddress("metrics token");
    who.remote = peer.network;
    who.scraper = true;
    const MutexLock lock(mutex_);
    good_tokens_.FindOr(hash, -absl::InfiniteDuration());
    return std::nullopt;
  }
  std::optional<TokenRow> row;
  if (token.has_value()) {
    const absl::Status status = context_.readers.Read([&](const Transaction& reader) {
      absl::StatusOr<TokenRow> found = reader.callers.TokenByHash(hash);
      if (found.ok()) row = *std::move(found);
      return absl::IsNotFound(found.status()) ? absl::OkStatus() : found.status();
    });
    if (!status.ok()) return ToApiError(status);
  }
  auto identity = IdentityOfToken(row, absl::ToUnixMillis(context_.clock.Now()),
                                  /*remote=*/peer.network);
  if (const auto* problem = std::get_if<TokenProblem>(&identity)) {
    return RefuseToken(peer, hash, *problem, row, action);
  }
  Accept(hash, row->id);
  who = std::get<Identity>(std::move(identity));
  return std::nullopt;
}

// Tokens that were good before pay for themselves; all others are tries of the address.
std::optional<ApiError> Guard::CheckTries(const Peer& peer, const std::string& hash) {
  const absl::Duration now = context_.clock.Monotonic();
  const MutexLock lock(mutex_);
  if (good_tokens_.Find(hash) != nullptr) return std::nullopt;
  absl::Duration wait = wrong_tokens_.Wait(peer.key, now);
  if (wait == absl::ZeroDuration()) wait = requests_.Take(peer.key, now);
  if (wait == absl::ZeroDuration()) return std::nullopt;
  return TooMany("attempts with wrong tokens from your address", wait);
}

ApiError Guard::RefuseToken(const Peer& peer, const std::string& hash, TokenProblem problem,
                            const std::optional<TokenRow>& row, Action action) {
  {
    const MutexLock lock(mutex_);
    good_tokens_.Forget(hash);
    wrong_tokens_.Fail(peer.key, context_.clock.Monotonic());
  }
  Identity nobody = IdentityOfAddress(peer.key);
  if (problem == TokenProblem::kUnknown) {
    context_.access_log.Deny(nobody, action, "wrong token");
    return {401, "bad_token",
            "this is not a token of this server; check that you copied all of it, or ask an "
            "organiser for a new one"};
  }
  // Who holds an old token is known by its number.
  nobody.key = absl::StrCat("token ", row->id);
  const bool expired = problem == TokenProblem::kExpired;
  context_.access_log.Deny(nobody, action, expired ? "expired token" : "revoked token");
  return {401, "bad_token",
          absl::StrCat("the token ", expired ? "expired" : "was revoked", " at ",
                       DayOf(expired ? row->expires_at : row->revoked_at),
                       "; ask an organiser for a new one")};
}

void Guard::Accept(const std::string& hash, int64_t token) {
  const absl::Duration now = context_.clock.Monotonic();
  const MutexLock lock(mutex_);
  absl::Duration& noted = good_tokens_.FindOr(hash, -absl::InfiniteDuration());
  if (now - noted < kTouchEvery) return;
  noted = now;
  context_.access_log.Touch(token);
}

std::optional<ApiError> Guard::Count(const Identity& identity) {
  if (identity.role >= Role::kOrganiser) return std::nullopt;
  const absl::Duration now = context_.clock.Monotonic();
  const MutexLock lock(mutex_);
  const absl::Duration wait = requests_.Take(identity.key, now);
  if (wait == absl::ZeroDuration()) return std::nullopt;
  return TooMany("requests from you", wait);
}

bool IsOrganiser(const Peer& peer, const AccessConfig& access) {
  return RuledRole(UserOf(peer), access) >= Role::kOrganiser;
}

std::string PathOf(const std::string& address) {
  const std::string pattern = absl::StrReplaceAll(address, {{"[.]", "."}});
  std::string path;
  for (size_t i = 0; i < pattern.size(); ++i) {
    if (pattern[i] != '(') {
      path += pattern[i];
      continue;
    }
    const size_t end = std::min(pattern.find(')', i), pattern.size() - 1);
    const std::string group = pattern.substr(i, end - i);
    path += group.find("\\d") != std::string::npos     ? "ID"
            : group.find("a-f]") != std::string::npos ? "HASH"
                                                      : "NAME";
    i = end;
  }
  return path;
}

}  // namespace myograde::server
