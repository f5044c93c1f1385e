#include "server/board/acts.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/sha256.h"
#include "server/base/json_value.h"

namespace myograde::server {

using Json = nlohmann::json;

absl::StatusOr<Act> ActOfEntry(int64_t index, Json entry) {
  const Json kind = entry.is_object() ? entry.value("kind", Json()) : Json();
  const Json at = entry.is_object() ? entry.value("at", Json()) : Json();
  absl::Time time;
  if (!kind.is_string() || !at.is_string() ||
      !absl::ParseTime(absl::RFC3339_full, at.get<std::string>(), &time, nullptr)) {
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
          {"phase", TextOrNull(rejudge.board.phase)},
          {"track", rejudge.board.track},
          {"profile", rejudge.board.profile},
          {"from_config", rejudge.from_config},
          {"to_config", rejudge.to_config},
          {"method", EnumName(rejudge.method)},
          {"repeats", rejudge.repeats}};
}

}  // namespace myograde::server
