#include "server/api/resources.h"

#include <functional>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/access/token_text.h"
#include "server/api/paging.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json AddressToJson(const Address& address) {
  return {{"method", address.method},
          {"path", PathOf(address.pattern)},
          {"action", ActionName(address.action)},
          {"role", RoleName(RoleFor(address.action))},
          {"own_team", NeedsTeam(address.action)}};
}

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
    if (!address.page) list.push_back(AddressToJson(address));
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
    if (has_time) reader.Fail("valid_days", "is there beside expires_at; give one of them");
    const absl::Duration valid =
        absl::Hours(24) * reader.Integer("valid_days", 1, kMaxValidDays);
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

absl::StatusOr<NewToken> ParseToken(const Json& body, int64_t now_ms) {
  ConfigReader reader(body, "request");
  NewToken token;
  token.role = reader.Choice("role", {kParticipantRole, "organiser", "operator"});
  token.label = reader.String("label");
  if (!IsPlainText(token.label, kMaxLabelBytes)) {
    reader.Fail("label", absl::StrCat("must be 1 to ", kMaxLabelBytes,
                                      " bytes of text without control characters"));
  }
  if (reader.Has("team")) token.team = reader.String("team");
  if ((token.role == kParticipantRole) == token.team.empty()) {
    reader.Fail("team", token.team.empty() ? "is missing: a participant's token is for one team"
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
  return WithErrorCode(
      absl::PermissionDeniedError(
          "only an operator makes and revokes tokens of organisers and operators"),
      kForbiddenCode);
}

ApiResult ListEvents(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"kind", "before", "limit"});
  const std::string kind = request.Param("kind");
  if (request.HasParam("kind") && kind != "denied" && kind != "act") {
    status.Update(absl::InvalidArgumentError("\"kind\" must be denied or act"));
  }
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    const Listed<AccessEventRow> listed = reader.AccessEvents(kind, page->before, page->limit);
    Json events = Json::array();
    for (const AccessEventRow& event : listed.rows) events.push_back(EventToJson(event));
    answer.body = {{"events", std::move(events)}, {"unreadable", DamagedToJson(listed.damaged)}};
    AddNextPage(request, *page, listed, answer);
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult GetWhoami(const ApiContext& context, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  const Identity& caller = Caller();
  Json token;
  if (caller.token != 0) {
    RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
      const absl::StatusOr<TokenRow> row = reader.Token(caller.token);
      if (row.ok()) {
        token = {{"id", row->id},
                 {"label", row->label},
                 {"expires_at", TimeToJson(row->expires_at)}};
      }
      return row.status();
    }));
  }
  return ApiAnswer{200,
                   {{"role", RoleName(caller.role)},
                    {"teams", caller.teams},
                    {"token", std::move(token)},
                    {"caller", caller.key},
                    {"remote", caller.remote}}};
}

// The token as it is in the store.
ApiResult ShowToken(const ApiContext& context, int64_t id, int http, Json more) {
  ApiAnswer answer{http};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    ASSIGN_OR_RETURN(const TokenRow token, reader.Token(id));
    answer.body = TokenToJson(token, absl::ToUnixMillis(context.clock.Now()));
    return absl::OkStatus();
  }));
  answer.body.update(more);
  return answer;
}

ApiResult CreateToken(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(NewToken token, ParseToken(body, absl::ToUnixMillis(context.clock.Now())));
  RETURN_IF_ERROR(MayManage(token.role));
  ASSIGN_OR_RETURN(const std::string text, NewTokenText());
  token.hash = TokenHash(text);
  ASSIGN_OR_RETURN(const int64_t id, context.engine.Change<int64_t>(
      [row = token, who = CallerKey()](Writer& writer) { return writer.AddToken(row, who); },
      context.config.http.request));
  NoteAct(absl::StrCat("token ", id),
          absl::StrCat("made for ", token.team.empty() ? token.role : token.team, ": ",
                       token.label));
  return ShowToken(context, id, 201, {{"token", text}});
}

ApiResult ListTokens(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"before", "limit"});
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    const Listed<TokenRow> listed = reader.Tokens(page->before, page->limit);
    answer.body = {{"tokens", Json::array()}, {"unreadable", DamagedToJson(listed.damaged)}};
    for (const TokenRow& token : listed.rows) {
      answer.body["tokens"].push_back(TokenToJson(token, now));
    }
    AddNextPage(request, *page, listed, answer);
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult RevokeToken(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  RETURN_IF_ERROR(reader.Finish());
  const int64_t id = IdOf(request);
  // Of an unreadable row nobody knows the role, so that it takes an operator.
  std::string role = "operator";
  RETURN_IF_ERROR(context.readers.Read([&](Reader& store) {
    const absl::StatusOr<TokenRow> token = store.Token(id);
    if (token.ok()) role = token->role;
    return absl::IsNotFound(token.status()) ? token.status() : absl::OkStatus();
  }));
  RETURN_IF_ERROR(MayManage(role));
  ASSIGN_OR_RETURN(const bool changed, context.engine.Change<bool>(
      [id, who = CallerKey()](Writer& writer) { return writer.RevokeToken(id, who); },
      context.config.http.request));
  NoteAct(absl::StrCat("token ", id), changed ? "revoked" : "was revoked before");
  return ShowToken(context, id, 200, {{"changed", changed}});
}

}  // namespace

void AddAccess(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/addresses", Action::kReadApi,
             [&router = routes.router()](const Request& request) {
               return ListAddresses(request, router);
             });
  routes.Get("/v1/events", Action::kReadEvents, std::bind_front(ListEvents, std::cref(context)));
  routes.Get("/v1/whoami", Action::kReadApi, std::bind_front(GetWhoami, std::cref(context)));
  routes.Get("/v1/tokens", Action::kManageTokens, std::bind_front(ListTokens, std::cref(context)));
  routes.Post("/v1/tokens", Action::kManageTokens, std::bind_front(CreateToken, std::cref(context)));
  routes.Post(R"(/v1/tokens/(\d{1,18})/revoke)", Action::kManageTokens,
              std::bind_front(RevokeToken, std::cref(context)));
}

}  // namespace myograde::server
