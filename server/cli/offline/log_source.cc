#include "server/cli/offline/log_source.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "protocol/log/episode_log.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/play_logs.h"
#include "server/proof/logs.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

bool Names(const Json& receipt, const std::string& hash) {
  const Json& episodes = receipt["episodes"];
  return std::any_of(episodes.begin(), episodes.end(), [&](const Json& entry) {
    return entry.value("log", Json()) == Json(hash);
  });
}

// Why the file at `path`, with that hash, is not one of the receipt's.
std::string UnknownText(const std::string& path, const std::string& hash) {
  const absl::StatusOr<EpisodeLog> log = ParseLog(ReadLog(path));
  if (!log.ok()) return std::string(log.status().message());
  return absl::StrCat("the log of episode ", log->header.episode, " has the SHA-256 ", hash,
                      ", which the receipt does not name");
}

absl::StatusOr<std::string> ReadAs(const std::string& hash, const std::string& path) {
  absl::StatusOr<std::string> log = ReadLog(path);
  if (log.ok() && Sha256Hex(*log) != hash) {
    return absl::DataLossError(absl::StrCat(path, ": was altered: its SHA-256 is ",
                                            Sha256Hex(*log), ", the receipt says ", hash));
  }
  return log;
}

}  // namespace

LogSource::LogSource(const std::vector<std::string>& given, Client client)
    : client_(std::move(client)), given_(!given.empty()) {
  for (const std::string& path : given) {
    if (std::filesystem::is_directory(path)) {
      folders_.push_back(path);
    } else if (absl::StatusOr<std::string> log = ReadLog(path); log.ok()) {
      files_[Sha256Hex(*log)] = path;
    } else {
      unreadable_.push_back({"log " + path, false, std::string(log.status().message())});
    }
  }
}

std::vector<ReceiptCheck> LogSource::Check(const Json& receipt) const {
  std::vector<ReceiptCheck> checks = unreadable_;
  for (const auto& [hash, path] : files_) {
    const bool named = Names(receipt, hash);
    checks.push_back({absl::StrCat("log ", hash), named, named ? "" : UnknownText(path, hash)});
  }
  return checks;
}

absl::StatusOr<std::string> LogSource::Find(const std::string& hash) const {
  if (const auto it = files_.find(hash); it != files_.end()) return ReadAs(hash, it->second);
  for (const std::string& folder : folders_) {
    const std::string path = absl::StrCat(folder, "/", LogFileName(hash));
    if (std::filesystem::exists(path)) return ReadAs(hash, path);
  }
  if (given_) {
    return absl::NotFoundError(absl::StrCat("the log ", hash, " is not among those of --logs"));
  }
  return LogBytesOf(client_, hash);
}

}  // namespace myograde::server
