// myograde episode replay, and what the other verbs that play logs again share
#include "server/cli/offline/play_logs.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <regex>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/offline/local.h"
#include "server/cli/terminal/terminal.h"
#include "server/config/server_config.h"
#include "server/proof/logs.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {
namespace {

constexpr int kMostSimulators = 64;

// Blocks are leases; where nothing carries over, cut once more so that all slots have work.
std::vector<ReplayBlock> SplitIntoBlocks(const std::map<int64_t, ReplayLogFile>& files,
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
absl::StatusOr<std::string> FindSibling(const std::string& path, const LogHeader& header,
                                        int64_t episode) {
  const std::filesystem::path file(path);
  const std::string name = file.filename();
  // The last number before the ending that is the episode's.
  const std::regex numbered(
      absl::StrCat("(.*[^0-9]|)(0*", header.episode, ")((?:[^0-9].*)?\\.lcmlog.*)"));
  std::smatch parts;
  if (std::regex_match(name, parts, numbered)) {
    const auto with = [&](const std::string& text) {
      return (file.parent_path() / (parts[1].str() + text + parts[3].str())).string();
    };
    const std::string plain = absl::StrCat(episode);
    const auto digits = static_cast<size_t>(parts[2].length());
    std::error_code ignored;
    if (plain.size() >= digits || std::filesystem::exists(with(plain), ignored)) return with(plain);
    return with(std::string(digits - plain.size(), '0') + plain);
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": in the profile ", header.track.profile, " state carries over from earlier "
      "episodes, whose logs must be in the same folder; name each log after its episode, this "
      "one episode-", absl::Dec(header.episode, absl::kZeroPad3), ".lcmlog"));
}

}  // namespace

int64_t FirstNeeded(const TrackConfig& track, int64_t episode) {
  return CarriesOver(track) ? episode - episode % track.episodes_per_lease : episode;
}

absl::StatusOr<EpisodeLog> ParseLog(const absl::StatusOr<std::string>& bytes) {
  if (!bytes.ok()) return bytes.status();
  return ParseEpisodeLog(*bytes);
}

absl::StatusOr<ReplayLogFile> SaveLog(const std::string& folder, std::string_view bytes,
                                      LogHeader header) {
  const std::string path = absl::StrCat(folder, "/", header.episode, ".lcmlog");
  if (WriteFile(path, bytes).ok()) return ReplayLogFile{path, std::move(header)};
  return absl::InternalError(path + ": can't be written; is the disk full?");
}

absl::StatusOr<FetchedLog> FetchLog(const Client& client, const Json& evaluation, int64_t episode,
                                    const std::string& folder) {
  ASSIGN_OR_RETURN(const Json row, RowOf(evaluation, episode));
  ASSIGN_OR_RETURN(const std::string bytes, FetchLogBytes(client, row));
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
  const int64_t first = FirstNeeded(header.track, header.episode);
  for (int64_t episode = first; episode < header.episode; ++episode) {
    ASSIGN_OR_RETURN(const std::string sibling, FindSibling(absolute, header, episode));
    const absl::StatusOr<EpisodeLog> log = ParseLog(ReadLog(sibling));
    if (absl::IsNotFound(log.status())) {
      return absl::NotFoundError(absl::StrCat(
          sibling, " is missing: in the profile ", header.track.profile, " state carries over, so "
          "the logs of episodes ", first, " to ", header.episode - 1,
          " must be in the same folder as ", path));
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
                  "Simulators to run in parallel (default: as in server.json, one for each "
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
  ASSIGN_OR_RETURN(const ServerConfig config, BuildServerConfig(host));
  order.track = files.begin()->second.header.track;
  order.work_dir = temp.path();
  order.slots = slots > 0 ? slots : std::min(config.scheduler.slots, kMostSimulators);
  if (::geteuid() == 0) order.uid_base = config.uid_base + kReplayUsers;
  order.blocks = SplitIntoBlocks(files, order.track, order.slots);
  Progress progress("replay");
  return RunReplay(order, {.progress = progress.Listener(), .stopped = StopRequested});
}

namespace {

struct ReplayOptions : DaemonOptions {
  HostOptions host;
  std::string target;
  int64_t episode = -1;  // -1: all
  int slots = 0;         // 0: as server.json says
};

ReplayRecord Unplayable(int64_t episode, const absl::Status& status) {
  ReplayRecord record;
  record.episode = episode;
  record.differs = {"log"};
  record.detail = std::string(status.message());
  return record;
}

// A folder of the logs to play, by episode, and the records of those that can't be played.
struct Collected {
  std::map<int64_t, ReplayLogFile> files;
  std::map<int64_t, ReplayRecord> records;
};

// The logs that are needed to play `episode`: of all (-1), or its own and those before it.
absl::StatusOr<Collected> CollectOfSubmission(int64_t episode, const Client& client,
                                              const Json& evaluation, const std::string& folder) {
  Collected collected;
  std::vector<int64_t> needed = {episode};
  if (episode < 0) {
    needed.clear();
    for (const Json& row : evaluation["episode_rows"]) {
      needed.push_back(row.value("index", int64_t{-1}));
    }
  }
  for (size_t i = 0; i < needed.size(); ++i) {
    absl::StatusOr<FetchedLog> fetched = FetchLog(client, evaluation, needed[i], folder);
    if (absl::IsDataLoss(fetched.status())) {
      collected.records[needed[i]] = Unplayable(needed[i], fetched.status());
      continue;
    }
    if (!fetched.ok()) return fetched.status();
    // Its own log tells which come before.
    const int64_t first = FirstNeeded(fetched->log.header.track, needed[i]);
    if (needed[i] == episode) {
      for (int64_t before = first; before < episode; ++before) needed.push_back(before);
    }
    collected.files[needed[i]] = std::move(fetched->file);
  }
  return collected;
}

absl::StatusOr<int> ReportReplay(const ReplayOptions& options, Json head,
                                 const std::vector<ReplayRecord>& records) {
  const auto equal = std::count_if(records.begin(), records.end(),
                                   [](const ReplayRecord& record) { return record.equal; });
  const bool all = equal == std::ssize(records) && !records.empty();
  head["equal"] = all;
  head["replayed"] = records.size();
  head["episodes"] = Json::array();
  for (const ReplayRecord& record : records) {
    head["episodes"].push_back({{"index", record.episode},
                                {"equal", record.equal},
                                {"steps", record.steps},
                                {"step", record.step < 0 ? Json() : Json(record.step)},
                                {"differs", record.differs},
                                {"detail", TextOrNull(record.detail)}});
  }
  return PrintAnswer(
      head, options.json,
      [&](const Json& replay) {
        for (const Json& episode : replay["episodes"]) {
          if (!episode["equal"]) std::cout << Filled(episode, "episode {index}: {detail}\n");
        }
        std::cout << Bold(absl::StrCat(equal, Filled(replay,
                                                     " of {replayed:episode} match the recording")))
                  << std::endl;
      },
      all ? kDone : kNoScore);
}

absl::StatusOr<int> ReplayFile(const ReplayOptions& options) {
  const Json head = {{"submission", nullptr}, {"evaluation", nullptr}, {"file", options.target}};
  absl::StatusOr<std::string> bytes = ReadLog(options.target);
  // No file that could hold a log at all.
  if (absl::IsNotFound(bytes.status()) || absl::IsInvalidArgument(bytes.status())) {
    return bytes.status();
  }
  absl::StatusOr<EpisodeLog> log = ParseLog(bytes);
  if (!log.ok()) return ReportReplay(options, head, {Unplayable(0, log.status())});
  ASSIGN_OR_RETURN(const auto files, LogsUpTo(options.target, log->header));
  ASSIGN_OR_RETURN(const std::vector<ReplayRecord> records,
                   PlayLogs(files, options.host, options.slots));
  return ReportReplay(options, head, {records.back()});
}

absl::StatusOr<int> ReplaySubmission(const ReplayOptions& options, int64_t id) {
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("logs"));
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json evaluation,
                   EvaluationWithRows(client, absl::StrCat("/v1/submissions/", id, "/result")));
  ASSIGN_OR_RETURN(Collected collected,
                   CollectOfSubmission(options.episode, client, evaluation, temp.path()));
  ASSIGN_OR_RETURN(const std::vector<ReplayRecord> played,
                   PlayLogs(collected.files, options.host, options.slots));
  for (const ReplayRecord& record : played) collected.records[record.episode] = record;
  std::vector<ReplayRecord> records;
  for (const auto& [episode, record] : collected.records) {
    if (options.episode < 0 || episode == options.episode) records.push_back(record);
  }
  if (records.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", id, " has no recorded episode yet"));
  }
  const Json head = {
      {"submission", id}, {"evaluation", evaluation["evaluation"]}, {"file", nullptr}};
  return ReportReplay(options, head, records);
}

absl::StatusOr<int> Replay(const ReplayOptions& options) {
  int64_t id = 0;
  if (absl::SimpleAtoi(options.target, &id) && id > 0) return ReplaySubmission(options, id);
  RETURN_IF_ERROR(RefuseIf({{options.episode >= 0,
                             "--episode: a log file holds one episode; leave the option out"}}));
  return ReplayFile(options);
}

}  // namespace

Command AddReplay(CLI::App& verb) {
  auto options = std::make_shared<ReplayOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde episode log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "Only this episode, counted from 0 (default: all)")
      ->check(WholeNumber(0, "not an episode's number, counted from 0"));
  AddSimulatorSlots(verb, options->slots);
  AddDaemonOptions(verb, "replay", *options);
  AddHostOptions(verb, options->host);
  return [options] { return Replay(*options); };
}

}  // namespace myograde::server
