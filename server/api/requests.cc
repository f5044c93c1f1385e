#include "server/api/requests.h"

#include <algorithm>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/base/names.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr char kWhere[] = "request";
constexpr size_t kMaxReasonBytes = 200;
constexpr char kKeyHeader[] = "idempotency-key";
constexpr size_t kMaxKeyBytes = 255;
constexpr int64_t kMaxLimit = 1000;

}  // namespace

std::string ReadReason(ConfigReader& reader) {
  std::string reason = reader.String("reason");
  if (!IsPlainText(reason, kMaxReasonBytes)) {
    reader.Fail("reason", absl::StrCat("must be 1 to ", kMaxReasonBytes,
                                       " bytes of text without control characters"));
  }
  return reason;
}

// Of a key that is there.
std::string ReadPhaseName(ConfigReader& reader) {
  std::string phase = reader.String("phase");
  if (!IsTrackName(phase)) reader.Fail("phase", "must be the name of a phase");
  return phase;
}

absl::StatusOr<SubmitRequest> ParseSubmit(const nlohmann::json& body) {
  ConfigReader reader(body, kWhere);
  SubmitRequest request;
  request.artefact = reader.String("artefact");
  request.team = reader.String("team");
  request.track = reader.String("track");
  if (reader.Has("profile")) request.profile = reader.String("profile");
  if (reader.Has("phase")) request.phase = ReadPhaseName(reader);
  const nlohmann::json* seeds = reader.Has("seeds") ? &reader.Array("seeds") : nullptr;
  if (reader.Has("episodes")) request.episodes = reader.Integer("episodes", 1, kMaxEpisodes);
  if (!IsSha256Hex(request.artefact)) {
    reader.Fail("artefact", "must be the id of an artefact: 64 lower-case hexadecimal digits");
  }
  RETURN_IF_ERROR(reader.Finish());
  RETURN_IF_ERROR(CheckTeam(request.team));
  if (seeds != nullptr) {
    ASSIGN_OR_RETURN(request.seeds, ParseSeeds(*seeds, "request: \"seeds\""));
  }
  return request;
}

absl::StatusOr<RerunRequest> ParseRerun(const nlohmann::json& body) {
  ConfigReader reader(body, kWhere);
  RerunRequest request;
  if (reader.Has("first")) request.first = reader.Integer("first", 0, kMaxEpisodes - 1);
  if (reader.Has("last")) request.last = reader.Integer("last", 0, kMaxEpisodes - 1);
  if (request.first.has_value() != request.last.has_value()) {
    reader.Fail(request.first ? "last" : "first", "is missing: both or none must be given");
  } else if (request.first && *request.last < *request.first) {
    reader.Fail("last", absl::StrCat("is ", *request.last, ", which is before first"));
  }
  RETURN_IF_ERROR(reader.Finish());
  return request;
}

absl::StatusOr<std::string> ParseCancel(const nlohmann::json& body) {
  ConfigReader reader(body, kWhere);
  std::string reason = "cancelled by request";
  if (reader.Has("reason")) reason = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return reason;
}

absl::Status CheckParameters(const Request& request, const std::vector<std::string>& known) {
  for (const auto& [key, value] : request.params) {
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      return absl::InvalidArgumentError(
          absl::StrCat("\"", key, "\" is not a parameter of this address; known: ",
                       known.empty() ? "none" : absl::StrJoin(known, ", ")));
    }
    if (request.params.count(key) > 1) {
      return absl::InvalidArgumentError(absl::StrCat("\"", key, "\" appears twice"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<Page> ReadPage(const Request& request, std::vector<std::string> others) {
  others.insert(others.end(), {"before", "limit"});
  RETURN_IF_ERROR(CheckParameters(request, others));
  Page page;
  RETURN_IF_ERROR(ReadNumber(request, "before", page.before, page.before));
  RETURN_IF_ERROR(ReadNumber(request, "limit", kMaxLimit, page.limit));
  return page;
}

absl::StatusOr<std::string> ParseReason(const nlohmann::json& body) {
  ConfigReader reader(body, kWhere);
  std::string reason = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return reason;
}

absl::Status ParseNothing(const nlohmann::json& body) {
  return ConfigReader(body, kWhere).Finish();
}

absl::StatusOr<NewGrant> ParseGrant(const nlohmann::json& body) {
  ConfigReader reader(body, kWhere);
  NewGrant grant;
  grant.team = reader.String("team");
  grant.track = reader.String("track");
  if (reader.Has("phase")) grant.phase = ReadPhaseName(reader);
  grant.budget = ParseEnum<Budget>(reader.Choice("budget", {"official", "practice", "failed"}))
                     .value_or(Budget::kRanked);
  grant.amount = reader.Integer("amount", 1, 1'000'000);
  grant.why = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  RETURN_IF_ERROR(CheckTeam(grant.team));
  return grant;
}

absl::StatusOr<RequestKey> ReadRequestKey(const Request& request, const nlohmann::json& body) {
  const auto found = request.headers.find(kKeyHeader);
  if (found == request.headers.end()) return RequestKey();
  const std::string& key = found->second;
  const bool good = request.headers.count(kKeyHeader) == 1 && !key.empty() &&
                    key.size() <= kMaxKeyBytes &&
                    std::all_of(key.begin(), key.end(), [](char c) { return c > ' ' && c < 0x7f; });
  if (!good) {
    return absl::InvalidArgumentError(
        absl::StrCat("the header Idempotency-Key must appear once, with 1 to ", kMaxKeyBytes,
                     " visible ASCII characters without spaces"));
  }
  return RequestKey{key, Sha256Hex(absl::StrCat(request.path, "\n", CanonicalJson(body)))};
}

absl::Status CheckTeam(const std::string& team) {
  if (IsPlainText(team, kMaxNameBytes)) return absl::OkStatus();
  return CleanName(team, "\"team\"").status();
}

absl::Status ReadNumber(const Request& request, const char* key, int64_t max, int64_t& value,
                        int64_t min) {
  if (!request.HasParam(key)) return absl::OkStatus();
  const std::string text = request.Param(key);
  // SimpleAtoi alone takes signs and spaces too.
  const bool digits = text.find_first_not_of("0123456789") == std::string::npos;
  if (digits && absl::SimpleAtoi(text, &value) && value >= min && value <= max) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("\"", key, "\" must be a whole number from ", min, " to ", max));
}

absl::StatusOr<bool> ReadFlag(const Request& request, const char* key) {
  const std::string text = request.HasParam(key) ? request.Param(key) : "false";
  if (text == "true" || text == "false") return text == "true";
  return absl::InvalidArgumentError(absl::StrCat("\"", key, "\" must be true or false"));
}

absl::StatusOr<bool> ReadSwitch(const Request& request, const char* key, bool fallback) {
  const std::string text = request.Param(key);
  if (text.empty()) return fallback;
  if (text == "0" || text == "1") return text == "1";
  return absl::InvalidArgumentError(absl::StrCat("\"", key, "\" must be 0 or 1"));
}

absl::StatusOr<SubmissionFilter> ParseFilter(const Request& request) {
  ASSIGN_OR_RETURN(const Page page,
                   ReadPage(request, {"team", "track", "profile", "phase", "state"}));
  SubmissionFilter filter{.before = page.before, .limit = page.limit};
  filter.team = request.Param("team");
  filter.track = request.Param("track");
  filter.profile = request.Param("profile");
  filter.phase = request.Param("phase");
  if (request.HasParam("state")) {
    filter.state = ParseEnum<EvaluationState>(request.Param("state"));
    if (!filter.state) {
      return absl::InvalidArgumentError(
          "\"state\" must be queued, running, done, failed, cancelled or grader_error");
    }
  }
  return filter;
}

int64_t ReadId(const Request& request) { return std::stoll(request.matches[1]); }

}  // namespace myograde::server
