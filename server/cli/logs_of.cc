#include "server/cli/logs_of.h"

#include <absl/strings/str_cat.h>

#include "server/proof/unpack_log.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

std::string HashOf(const Json& row) {
  const auto log = row.find("log");
  if (log == row.end() || !log->is_object()) return "";
  return log->value("sha256", "");
}

}  // namespace

absl::StatusOr<Json> EvaluationWithRows(const Client& client, const std::string& path) {
  absl::StatusOr<Json> json = client.Get(path + "?episodes=1");
  if (json.ok() && !json->value("episode_rows", Json()).is_array()) {
    return absl::InternalError("the daemon's answer has no episode_rows");
  }
  return json;
}

absl::StatusOr<Json> RowOf(const Json& evaluation, int64_t episode) {
  for (const Json& row : evaluation["episode_rows"]) {
    if (row.value("index", int64_t{-1}) == episode) return row;
  }
  return absl::OutOfRangeError(absl::StrCat("submission ", evaluation.value("submission", 0),
                                            " has no recorded episode ", episode));
}

absl::StatusOr<std::string> PackedLogOf(const Client& client, const Json& row) {
  const std::string hash = HashOf(row);
  if (hash.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("no log of episode ", row.value("index", -1), " was kept"));
  }
  return client.GetBytes("/v1/logs/" + hash);
}

absl::StatusOr<std::string> LogBytesOf(const Client& client, const Json& row) {
  absl::StatusOr<std::string> packed = PackedLogOf(client, row);
  if (!packed.ok()) return packed.status();
  absl::StatusOr<std::string> log = UnpackLogOf(HashOf(row), *packed);
  if (log.ok()) return log;
  return absl::Status(log.status().code(), absl::StrCat("episode ", row.value("index", -1), ": ",
                                                        log.status().message()));
}

absl::StatusOr<EpisodeLog> LogOf(const Client& client, const Json& row) {
  absl::StatusOr<std::string> bytes = LogBytesOf(client, row);
  if (!bytes.ok()) return bytes.status();
  return ParseEpisodeLog(*bytes);
}

}  // namespace myograde::server
