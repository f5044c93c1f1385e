#include "server/cli/offline/play_logs.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "protocol/base/status_macros.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/terminal/progress.h"
#include "server/config/server_config.h"
#include "server/proof/logs.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {
namespace {

constexpr int kMostSimulators = 64;

// Blocks are leases; where nothing carries over, cut once more so that all slots have work.
std::vector<ReplayBlock> BlocksOf(const std::map<int64_t, ReplayLogFile>& files,
                                  const TrackConfig& track, int slots) {
  std::vector<ReplayBlock> blocks;
  const bool carries = CarriesOver(track);
  const int64_t per_slot = (std::ssize(files) + slots - 1) / slots;
  int64_t previous = -2;
  for (const auto& [episode, file] : files) {
    const bool follows = episode == previous + 1 && !blocks.empty();
    const bool full = follows && std::ssize(blocks.back().logs) >= per_slot;
    if (!follows || file.header.first || (full && !carries)) blocks.emplace_back();
    blocks.back().episodes.push_back({episode, file.header.seed, 0});
    blocks.back().logs.push_back(file.path);
    previous = episode;
  }
  return blocks;
}

// The file beside `path` that should be the log of `episode`.
absl::StatusOr<std::string> SiblingOf(const std::string& path, const LogHeader& header,
                                      int64_t episode) {
  const std::filesystem::path file(path);
  const std::string name = file.filename();
  constexpr const char* kDigits = "0123456789";
  for (size_t end = name.rfind(".lcmlog"); end != std::string::npos && end > 0;) {
    const size_t last = name.find_last_of(kDigits, end - 1);
    if (last == std::string::npos) break;
    const size_t before = name.find_last_not_of(kDigits, last);
    const size_t begin = before == std::string::npos ? 0 : before + 1;
    const std::string digits = name.substr(begin, last + 1 - begin);
    int64_t number = -1;
    if (absl::SimpleAtoi(digits, &number) && number == header.episode) {
      const auto with = [&](const std::string& text) {
        return file.parent_path() / absl::StrCat(name.substr(0, begin), text, name.substr(last + 1));
      };
      const std::string plain = absl::StrCat(episode);
      const std::string padded =
          std::string(digits.size() - std::min(digits.size(), plain.size()), '0') + plain;
      std::error_code ignored;
      return (std::filesystem::exists(with(plain), ignored) ? with(plain) : with(padded)).string();
    }
    end = begin;
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": in the profile ", header.track.profile, " state carries over from the episodes before, "
      "whose logs are looked for beside it by their names; name each after its episode, this one "
      "episode-", absl::Dec(header.episode, absl::kZeroPad3), ".lcmlog"));
}

}  // namespace

int64_t FirstOfLease(const TrackConfig& track, int64_t episode) {
  return episode - episode % track.episodes_per_lease;
}

absl::StatusOr<EpisodeLog> ParseLog(const absl::StatusOr<std::string>& bytes) {
  if (!bytes.ok()) return bytes.status();
  return ParseEpisodeLog(*bytes);
}

absl::StatusOr<ReplayLogFile> SaveLog(const std::string& folder, std::string_view bytes,
                                      LogHeader header) {
  const std::string path = absl::StrCat(folder, "/", header.episode, ".lcmlog");
  std::ofstream file(path, std::ios::binary);
  file.write(bytes.data(), std::ssize(bytes));
  file.close();
  if (!file) return absl::InternalError(path + ": can't be written; is the disk full?");
  return ReplayLogFile{path, std::move(header)};
}

absl::StatusOr<FetchedLog> FetchLog(const Client& client, const Json& evaluation, int64_t episode,
                                    const std::string& folder) {
  ASSIGN_OR_RETURN(const Json row, RowOf(evaluation, episode));
  ASSIGN_OR_RETURN(const std::string bytes, LogBytesOf(client, row));
  ASSIGN_OR_RETURN(EpisodeLog log, ParseEpisodeLog(bytes));
  const Json hashes = evaluation.value("hashes", Json::object());
  if (log.header.config != hashes.value("config", "") || log.header.episode != episode) {
    return absl::DataLossError(absl::StrCat(
        "episode ", episode, ": the log is of another episode or config than its record"));
  }
  ASSIGN_OR_RETURN(ReplayLogFile file, SaveLog(folder, bytes, log.header));
  return FetchedLog{std::move(file), std::move(log)};
}

absl::StatusOr<std::map<int64_t, ReplayLogFile>> LogsUpTo(const std::string& path,
                                                          const LogHeader& header) {
  const std::string absolute = std::filesystem::absolute(path);
  std::map<int64_t, ReplayLogFile> files = {{header.episode, {absolute, header}}};
  if (!CarriesOver(header.track)) return files;
  const int64_t first = FirstOfLease(header.track, header.episode);
  for (int64_t episode = first; episode < header.episode; ++episode) {
    ASSIGN_OR_RETURN(const std::string sibling, SiblingOf(absolute, header, episode));
    const absl::StatusOr<EpisodeLog> log = ParseLog(ReadLog(sibling));
    if (absl::IsNotFound(log.status())) {
      return absl::NotFoundError(absl::StrCat(
          sibling, " is missing: in the profile ", header.track.profile, " state carries over, so "
          "the logs of the episodes ", first, " to ", header.episode - 1, " must be beside ", path));
    }
    if (!log.ok()) return log.status();
    if (log->header.config != header.config || log->header.episode != episode) {
      return absl::InvalidArgumentError(absl::StrCat(
          sibling, ": is not the log of episode ", episode, " under the config of ", path));
    }
    files[episode] = {sibling, log->header};
  }
  return files;
}

void AddSimulatorSlots(CLI::App& verb, int& slots) {
  verb.add_option("--slots", slots,
                  "Simulators to run at a time (default: as in server.json, one for each "
                  "processor)")
      ->check(CLI::Range(1, kMostSimulators));
}

absl::StatusOr<std::vector<ReplayRecord>> PlayLogs(const std::map<int64_t, ReplayLogFile>& files,
                                                   const HostOptions& host, int slots) {
  if (files.empty()) return std::vector<ReplayRecord>();
  CatchStopSignals();
  ASSIGN_OR_RETURN(TempFolder temp, TempFolder::Make("replay"));
  ReplayOrder order;
  order.cache_dir = host.cache_dir();
  ASSIGN_OR_RETURN(
      const ServerConfig config,
      HostStatus("", LoadServerConfig(host.configs_dir() + "/server.json", order.cache_dir)));
  order.track = files.begin()->second.header.track;
  order.work_dir = temp.path();
  order.slots = slots > 0 ? slots : std::min(config.scheduler.slots, kMostSimulators);
  if (::geteuid() == 0) order.uid_base = config.uid_base + kReplayUsers;
  order.blocks = BlocksOf(files, order.track, order.slots);
  Progress progress("replay");
  return RunReplay(order, {.progress = progress.Listener(), .stopped = StopRequested});
}

}  // namespace myograde::server
