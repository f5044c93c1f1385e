#include "server/board/acts.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/sha256.h"
#include "server/base/json_value.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

std::string TextOrEmpty(const Json& value) {
  return value.is_null() ? "" : value.get<std::string>();
}

}  // namespace

absl::StatusOr<Act> ActOfEntry(int64_t index, Json entry) {
  const Json kind = entry.is_object() ? entry.value("kind", Json()) : Json();
  const Json at = entry.is_object() ? entry.value("at", Json()) : Json();
  absl::Time time;
  std::string error;
  if (!kind.is_string() || !at.is_string() ||
      !absl::ParseTime(absl::RFC3339_full, at.get<std::string>(), &time, &error)) {
    return absl::InvalidArgumentError(absl::StrCat("entry ", index, " has no kind, or no time"));
  }
  return Act{.id = index + 1,
             .at = absl::ToUnixMillis(time),
             .kind = kind.get<std::string>(),
             .who = "",
             .entry = index,
             .content = std::move(entry)};
}

std::string ArtefactCommitment(int64_t submission, const std::string& artefact) {
  return Sha256Hex(absl::StrCat("myograde artefact/", submission, "/", artefact));
}

Json RejudgeKeys(const RejudgeRow& rejudge) {
  return {{"rejudge", rejudge.id},
          {"purpose", EnumName(rejudge.purpose)},
          {"phase", TextOrNull(rejudge.phase)},
          {"track", rejudge.track},
          {"profile", rejudge.profile},
          {"from_config", rejudge.from_config},
          {"to_config", rejudge.to_config},
          {"method", EnumName(rejudge.method)},
          {"repeats", rejudge.repeats}};
}

RejudgeRow RejudgeOfDocument(const Json& document) {
  const auto text = [&](const char* key) { return TextOrEmpty(document.at(key)); };
  RejudgeRow rejudge;
  rejudge.id = document.at("rejudge").get<int64_t>();
  rejudge.purpose = ParseEnum<RejudgePurpose>(text("purpose")).value_or(RejudgePurpose::kRules);
  rejudge.phase = text("phase");
  rejudge.track = text("track");
  rejudge.profile = text("profile");
  rejudge.from_config = text("from_config");
  rejudge.to_config = text("to_config");
  rejudge.seeds = text("seeds");
  rejudge.method = ParseEnum<RejudgeMethod>(text("method")).value_or(RejudgeMethod::kAuto);
  rejudge.repeats = document.at("repeats").get<int64_t>();
  rejudge.who = text("who");
  rejudge.why = text("reason");
  return rejudge;
}

}  // namespace myograde::server
