#include "server/api/tokens_resource.h"

#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include <absl/strings/str_cat.h>

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
  return StatusOf({403, "forbidden",
                  "only an operator makes and revokes tokens of organisers and operators"});
}

}  // namespace

void TokensResource::Install(Routes& routes) {
  routes.Get("/v1/tokens", Action::kManageTokens, std::bind_front(&TokensResource::List, this));
  routes.Post("/v1/tokens", Action::kManageTokens, std::bind_front(&TokensResource::Create, this));
  routes.Post(R"(/v1/tokens/(\d{1,18})/revoke)", Action::kManageTokens,
              std::bind_front(&TokensResource::Revoke, this));
}

ApiResult TokensResource::Create(const Request&, const Json& body) const {
  ASSIGN_OR_RETURN(NewToken token, ParseToken(body, absl::ToUnixMillis(context_.clock.Now())));
  RETURN_IF_ERROR(MayManage(token.role));
  ASSIGN_OR_RETURN(const std::string text, NewTokenText());
  token.hash = TokenHash(text);
  ASSIGN_OR_RETURN(const int64_t id, context_.engine.Change<int64_t>(
      [row = token, who = CallerKey()](Writer& writer) { return writer.AddToken(row, who); },
      context_.config.http.request));
  NoteAct(absl::StrCat("token ", id),
          absl::StrCat("made for ", token.team.empty() ? token.role : token.team, ": ",
                       token.label));
  return Show(id, 201, {{"token", text}});
}

ApiResult TokensResource::List(const Request& request) const {
  absl::Status status = CheckParameters(request, {"before", "limit"});
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  const int64_t now = absl::ToUnixMillis(context_.clock.Now());
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
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

ApiResult TokensResource::Revoke(const Request& request, const Json& body) const {
  ConfigReader reader(body, "request");
  RETURN_IF_ERROR(reader.Finish());
  const int64_t id = IdOf(request);
  // Of an unreadable row nobody knows the role, so that it takes an operator.
  std::string role = "operator";
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& store) {
    const absl::StatusOr<TokenRow> token = store.Token(id);
    if (token.ok()) role = token->role;
    return absl::IsNotFound(token.status()) ? token.status() : absl::OkStatus();
  }));
  RETURN_IF_ERROR(MayManage(role));
  ASSIGN_OR_RETURN(const bool changed, context_.engine.Change<bool>(
      [id, who = CallerKey()](Writer& writer) { return writer.RevokeToken(id, who); },
      context_.config.http.request));
  NoteAct(absl::StrCat("token ", id), changed ? "revoked" : "was revoked before");
  return Show(id, 200, {{"changed", changed}});
}

ApiResult TokensResource::Show(int64_t id, int http, Json more) const {
  ApiAnswer answer{http};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    ASSIGN_OR_RETURN(const TokenRow token, reader.Token(id));
    answer.body = TokenToJson(token, absl::ToUnixMillis(context_.clock.Now()));
    return absl::OkStatus();
  }));
  answer.body.update(more);
  return answer;
}

}  // namespace myograde::server
