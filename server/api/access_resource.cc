#include "server/api/resources.h"

#include <string>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "server/access/identity.h"
#include "server/base/error_code.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

Json EventToJson(const AccessEventRow& event) {
  return {{"id", event.id},
          {"at", TimeToJson(event.at)},
          {"kind", event.kind},
          {"who", event.who},
          {"role", TextOrNull(event.role)},
          {"action", event.action},
          {"subject", TextOrNull(event.subject)},
          {"detail", TextOrNull(event.detail)},
          {"count", event.count}};
}

ApiResult ListAddresses(const Request& request, const Router& router) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  Json list = Json::array();
  for (const Address& address : router.addresses()) {
    if (address.page) continue;
    list.push_back({{"method", address.method},
                    {"path", PathOf(address.pattern)},
                    {"action", ActionName(address.action)},
                    {"role", RoleName(RoleFor(address.action))},
                    {"own_team", NeedsTeam(address.action)}});
  }
  return ApiAnswer{200, {{"addresses", std::move(list)}}};
}

constexpr char kParticipantRole[] = "participant";
constexpr size_t kMaxLabelBytes = 100;
constexpr int64_t kMaxValidDays = 3650;

// "active", "expired" or "revoked".
std::string StateOf(const TokenRow& token, int64_t now_ms) {
  if (token.revoked_at != 0) return "revoked";
  return token.expires_at != 0 && token.expires_at <= now_ms ? "expired" : "active";
}

Json TokenToJson(const TokenRow& token, int64_t now_ms) {
  return {{"id", token.id},
          {"role", token.role},
          {"team", TextOrNull(token.team)},
          {"label", token.label},
          {"state", StateOf(token, now_ms)},
          {"created_at", TimeToJson(token.created_at)},
          {"created_by", token.created_by},
          {"expires_at", TimeToJson(token.expires_at)},
          {"revoked_at", TimeToJson(token.revoked_at)},
          {"revoked_by", TextOrNull(token.revoked_by)},
          {"last_used_at", TimeToJson(token.last_used_at)}};
}

// When it expires, of "expires_at" or "valid_days"; 0: never.
int64_t ReadExpiry(ConfigReader& reader, int64_t now_ms) {
  const bool has_time = reader.Has("expires_at");
  if (reader.Has("valid_days")) {
    if (has_time) reader.Fail("valid_days", "can't be combined with expires_at; give one of them");
    const absl::Duration valid = absl::Hours(24) * reader.Integer("valid_days", 1, kMaxValidDays);
    return now_ms + absl::ToInt64Milliseconds(valid);
  }
  if (!has_time) return 0;
  absl::Time time;
  const std::string text = reader.String("expires_at");
  if (!absl::ParseTime(absl::RFC3339_full, text, &time, nullptr) ||
      time > absl::FromUnixMillis(now_ms) + absl::Hours(24) * kMaxValidDays) {
    reader.Fail("expires_at", absl::StrCat("must be a time like 2026-12-01T00:00:00Z, at most ",
                                           kMaxValidDays, " days ahead"));
  } else if (time <= absl::FromUnixMillis(now_ms)) {
    reader.Fail("expires_at", "is in the past; choose a later time");
  }
  return absl::ToUnixMillis(time);
}

absl::StatusOr<TokenRow> ParseToken(const Json& body, int64_t now_ms) {
  ConfigReader reader(body, "request");
  TokenRow token;
  token.role = reader.Choice("role", {kParticipantRole, "organiser", "operator"});
  token.label = reader.String("label");
  if (!IsPlainText(token.label, kMaxLabelBytes)) {
    reader.Fail("label", absl::StrCat("must be 1 to ", kMaxLabelBytes,
                                      " bytes of text without control characters"));
  }
  if (reader.Has("team")) token.team = reader.String("team");
  if ((token.role == kParticipantRole) == token.team.empty()) {
    reader.Fail("team", token.team.empty() ? "is missing: a participant's token acts for one team"
                                           : "is only for tokens of participants; leave it out");
  }
  token.expires_at = ReadExpiry(reader, now_ms);
  RETURN_IF_ERROR(reader.Finish());
  if (!token.team.empty()) {
    RETURN_IF_ERROR(CheckTeam(token.team));
  }
  return token;
}

// Nobody hands out more than they have.
absl::Status MayManage(const std::string& role) {
  if (role == kParticipantRole || CallerMay(Action::kManageOperators)) return absl::OkStatus();
  NoteDenial("role");
  return WithErrorCode(absl::PermissionDeniedError(
                           "only operators may create and revoke tokens of organisers and "
                           "operators"),
                       kForbiddenCode);
}

ApiResult ListEvents(const ApiContext&, const Transaction& reader, const Request& request) {
  ASSIGN_OR_RETURN(const Page page, ReadPage(request, {"kind"}));
  const std::string kind = request.Param("kind");
  if (request.HasParam("kind") && kind != "denied" && kind != "act") {
    return absl::InvalidArgumentError("\"kind\" must be denied or act");
  }
  return PageAnswer(request, page, "events", reader.callers.Events(kind, page.before, page.limit),
                    [](const AccessEventRow& event) { return EventToJson(event); });
}

ApiResult GetWhoami(const ApiContext& context, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  const Identity& caller = Caller();
  Json token;
  if (caller.token != 0) {
    ASSIGN_OR_RETURN(const TokenRow row, ReadStore(context, [&](const Transaction& reader) {
      return reader.callers.Token(caller.token);
    }));
    token = {{"id", row.id}, {"label", row.label}, {"expires_at", TimeToJson(row.expires_at)}};
  }
  return ApiAnswer{200,
                   {{"role", RoleName(caller.role)},
                    {"teams", caller.teams},
                    {"token", std::move(token)},
                    {"caller", caller.key},
                    {"remote", caller.remote}}};
}

ApiResult ShowToken(const ApiContext& context, int64_t id, int http, Json more) {
  ASSIGN_OR_RETURN(const TokenRow token, ReadStore(context, [&](const Transaction& reader) {
    return reader.callers.Token(id);
  }));
  Json body = TokenToJson(token, absl::ToUnixMillis(context.clock.Now()));
  body.update(more);
  return ApiAnswer{http, std::move(body)};
}

ApiResult CreateToken(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(const TokenRow token, ParseToken(body, absl::ToUnixMillis(context.clock.Now())));
  RETURN_IF_ERROR(MayManage(token.role));
  ASSIGN_OR_RETURN(const std::string text, NewTokenText());
  const auto add = [hash = TokenHash(text), token, who = CallerKey()](Transaction& writer) {
    return writer.callers.AddToken(hash, token, who);
  };
  ASSIGN_OR_RETURN(const int64_t id, ChangeStore(context, add));
  NoteAct(
      absl::StrCat("token ", id),
      absl::StrCat("made for ", token.team.empty() ? token.role : token.team, ": ", token.label));
  return ShowToken(context, id, 201, {{"token", text}});
}

ApiResult ListTokens(const ApiContext& context, const Transaction& reader, const Request& request) {
  ASSIGN_OR_RETURN(const Page page, ReadPage(request));
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  return PageAnswer(request, page, "tokens", reader.callers.Tokens(page.before, page.limit),
                    [&](const TokenRow& token) { return TokenToJson(token, now); });
}

ApiResult RevokeToken(const ApiContext& context, const Request& request, const Json& body) {
  RETURN_IF_ERROR(ParseNothing(body));
  const int64_t id = ReadId(request);
  // Of an unreadable row nobody knows the role, so that it takes an operator.
  std::string role = "operator";
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& store) {
    const absl::StatusOr<TokenRow> token = store.callers.Token(id);
    if (token.ok()) role = token->role;
    return absl::IsNotFound(token.status()) ? token.status() : absl::OkStatus();
  }));
  RETURN_IF_ERROR(MayManage(role));
  const auto revoke = [id, who = CallerKey()](Transaction& writer) {
    return writer.callers.RevokeToken(id, who);
  };
  ASSIGN_OR_RETURN(const bool changed, ChangeStore(context, revoke));
  NoteAct(absl::StrCat("token ", id), changed ? "revoked" : "was revoked before");
  return ShowToken(context, id, 200, {{"changed", changed}});
}

}  // namespace

void AddAccess(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/addresses", Action::kReadApi,
             [&router = routes.router()](const Request& request) {
               return ListAddresses(request, router);
             });
  routes.Get("/v1/events", Action::kReadEvents, Bind(context, ListEvents));
  routes.Get("/v1/whoami", Action::kReadApi, Bind(context, GetWhoami));
  routes.Get("/v1/tokens", Action::kManageTokens, Bind(context, ListTokens));
  routes.Post("/v1/tokens", Action::kManageTokens, Bind(context, CreateToken));
  routes.Post(R"(/v1/tokens/(\d{1,18})/revoke)", Action::kManageTokens, Bind(context, RevokeToken));
}

}  // namespace myograde::server
