// myograde replay
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/logs_of.h"
#include "server/cli/replay.h"
#include "server/cli/progress.h"
#include "server/cli/terminal.h"
#include "server/base/counted.h"
#include "server/config/server_config.h"
#include "server/proof/unpack_log.h"
#include "server/sandbox/users.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ReplayOptions {
  ApiOptions daemon;
  HostOptions host;
  std::string target;
  int64_t episode = -1;  // -1: all
  int slots = 0;
  bool json = false;
};

volatile sig_atomic_t g_stopped = 0;

void OnSignal(int) { g_stopped = 1; }

// Whether state carries over from one episode to the next: then an episode can only be played
// after those before it in its lease.
bool CarriesOver(const TrackConfig& track) { return track.rules.value("one_environment", false); }

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

absl::Status Collect(const Client& client, const Json& row, const std::string& config,
                     const std::string& folder, Collected& collected) {
  const int64_t episode = row.value("index", int64_t{-1});
  absl::StatusOr<std::string> bytes = LogBytesOf(client, row);
  absl::StatusOr<EpisodeLog> log =
      bytes.ok() ? ParseEpisodeLog(*bytes) : absl::StatusOr<EpisodeLog>(bytes.status());
  if (log.ok() && (log->header.config != config || log->header.episode != episode)) {
    log = absl::DataLossError("the log is of another episode or config than its record");
  }
  if (absl::IsDataLoss(log.status())) {
    collected.records[episode] = Unplayable(episode, log.status());
    return absl::OkStatus();
  }
  if (!log.ok()) return log.status();
  const std::string path = absl::StrCat(folder, "/", episode, ".lcmlog");
  std::ofstream file(path, std::ios::binary);
  file.write(bytes->data(), std::ssize(*bytes));
  file.close();
  if (!file) return absl::InternalError(path + ": can't be written; is the disk full?");
  collected.files[episode] = {path, std::move(log->header)};
  return absl::OkStatus();
}

// The episodes to ask for so that `episode` can be played: all (-1), itself, or its lease until it.
absl::StatusOr<Collected> CollectOfSubmission(const ReplayOptions& options, const Client& client,
                                              const Json& evaluation, const std::string& folder) {
  Collected collected;
  const std::string config = evaluation["hashes"].value("config", "");
  std::vector<Json> rows;
  if (options.episode < 0) {
    rows.assign(evaluation["episode_rows"].begin(), evaluation["episode_rows"].end());
  } else {
    absl::StatusOr<Json> row = RowOf(evaluation, options.episode);
    if (!row.ok()) return row.status();
    rows.push_back(*std::move(row));
  }
  for (const Json& row : rows) {
    if (absl::Status status = Collect(client, row, config, folder, collected); !status.ok()) {
      return status;
    }
  }
  if (options.episode < 0 || collected.files.empty()) return collected;
  const TrackConfig& track = collected.files.begin()->second.header.track;
  if (!CarriesOver(track)) return collected;
  const int64_t first = options.episode - options.episode % track.episodes_per_lease;
  for (int64_t episode = first; episode < options.episode; ++episode) {
    absl::StatusOr<Json> row = RowOf(evaluation, episode);
    if (!row.ok()) return row.status();
    if (absl::Status status = Collect(client, *row, config, folder, collected); !status.ok()) {
      return status;
    }
  }
  return collected;
}

Json RecordToJson(const ReplayRecord& record) {
  return {{"index", record.episode},
          {"equal", record.equal},
          {"steps", record.steps},
          {"step", record.step < 0 ? Json() : Json(record.step)},
          {"differs", record.differs},
          {"detail", record.detail.empty() ? Json() : Json(record.detail)}};
}

int Report(const ReplayOptions& options, Json head, const std::vector<ReplayRecord>& records) {
  const auto equal = std::count_if(records.begin(), records.end(),
                                   [](const ReplayRecord& record) { return record.equal; });
  const bool all = equal == std::ssize(records) && !records.empty();
  if (options.json) {
    head["equal"] = all;
    head["replayed"] = records.size();
    head["episodes"] = Json::array();
    for (const ReplayRecord& record : records) head["episodes"].push_back(RecordToJson(record));
    PrintJson(head);
  } else {
    for (const ReplayRecord& record : records) {
      if (record.equal) continue;
      std::cout << "episode " << record.episode << ": " << Harmless(record.detail) << '\n';
    }
    std::cout << Bold(absl::StrCat(equal, " of ", Counted(std::ssize(records), "episode"),
                                   " came out as recorded"))
              << std::endl;
  }
  return all ? kDone : kNoScore;
}

int ReplayFile(const ReplayOptions& options) {
  const Json head = {{"submission", nullptr}, {"evaluation", nullptr}, {"file", options.target}};
  absl::StatusOr<std::string> bytes = ReadLog(options.target);
  absl::StatusOr<EpisodeLog> log =
      bytes.ok() ? ParseEpisodeLog(*bytes) : absl::StatusOr<EpisodeLog>(bytes.status());
  if (absl::IsNotFound(log.status())) return Complain(log.status());
  if (!log.ok()) return Report(options, head, {Unplayable(0, log.status())});
  if (CarriesOver(log->header.track) && !log->header.first) {
    return Complain(absl::InvalidArgumentError(absl::StrCat(
        options.target, ": in the profile ", log->header.track.profile, " state carries over from "
        "the episodes before; replay the submission by its number instead")));
  }
  const std::string path = std::filesystem::absolute(options.target);
  absl::StatusOr<std::vector<ReplayRecord>> records =
      PlayLogs({{log->header.episode, {path, log->header}}}, options.host, options.slots);
  if (!records.ok()) return Complain(records.status());
  return Report(options, head, *records);
}

int ReplaySubmission(const ReplayOptions& options, int64_t id) {
  absl::StatusOr<TempFolder> temp = TempFolder::Make("logs");
  if (!temp.ok()) return Complain(temp.status());
  const Client client(options.daemon.path());
  absl::StatusOr<Json> evaluation =
      EvaluationWithRows(client, absl::StrCat("/v1/submissions/", id, "/result"));
  if (!evaluation.ok()) return Complain(evaluation.status());
  absl::StatusOr<Collected> collected =
      CollectOfSubmission(options, client, *evaluation, temp->path());
  if (!collected.ok()) return Complain(collected.status());
  absl::StatusOr<std::vector<ReplayRecord>> played =
      PlayLogs(collected->files, options.host, options.slots);
  if (!played.ok()) return Complain(played.status());
  for (const ReplayRecord& record : *played) collected->records[record.episode] = record;
  std::vector<ReplayRecord> records;
  for (const auto& [episode, record] : collected->records) {
    if (options.episode < 0 || episode == options.episode) records.push_back(record);
  }
  if (records.empty()) {
    return Complain(absl::FailedPreconditionError(
        absl::StrCat("submission ", id, " has no recorded episode yet")));
  }
  return Report(options,
                {{"submission", id},
                 {"evaluation", (*evaluation)["evaluation"]},
                 {"file", nullptr}},
                records);
}

int Replay(const ReplayOptions& options) {
  int64_t id = 0;
  if (absl::SimpleAtoi(options.target, &id) && id > 0) return ReplaySubmission(options, id);
  if (options.episode >= 0) {
    return Complain(absl::InvalidArgumentError(
        "--episode: a log file holds one episode; leave the option out"));
  }
  return ReplayFile(options);
}

}  // namespace

absl::StatusOr<std::vector<ReplayRecord>> PlayLogs(const std::map<int64_t, ReplayLogFile>& files,
                                                   const HostOptions& host, int slots) {
  if (files.empty()) return std::vector<ReplayRecord>();
  struct sigaction action = {};
  action.sa_handler = OnSignal;  // no SA_RESTART: poll shall return
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
  absl::StatusOr<TempFolder> temp = TempFolder::Make("replay");
  if (!temp.ok()) return temp.status();
  ReplayOrder order;
  order.cache_dir = host.cache_dir();
  absl::StatusOr<ServerConfig> config =
      LoadServerConfig(host.configs_dir() + "/server.json", order.cache_dir);
  if (!config.ok()) return HostStatus("", config.status());
  order.track = files.begin()->second.header.track;
  order.work_dir = temp->path();
  order.slots = slots > 0 ? slots : std::min(config->scheduler.slots, 64);
  if (::geteuid() == 0) order.uid_base = config->uid_base + kReplayUsers;
  // Blocks are leases; where nothing carries over, cut once more so that all slots have work.
  const bool carries = CarriesOver(order.track);
  const int64_t per_slot = (std::ssize(files) + order.slots - 1) / order.slots;
  int64_t previous = -2;
  for (const auto& [episode, file] : files) {
    const bool follows = episode == previous + 1 && !order.blocks.empty();
    const bool full = follows && std::ssize(order.blocks.back().logs) >= per_slot;
    if (!follows || file.header.first || (full && !carries)) order.blocks.emplace_back();
    order.blocks.back().episodes.push_back({episode, file.header.seed, 0});
    order.blocks.back().logs.push_back(file.path);
    previous = episode;
  }
  Progress progress("replay");
  return RunReplay(order, {.progress = [&](int64_t done, int64_t total) {
                             progress.Show(done, total, "");
                           },
                           .stopped = [] { return g_stopped != 0; }});
}

Action AddReplay(CLI::App& verb) {
  auto options = std::make_shared<ReplayOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "Only this one, counted from 0 (default: all)")
      ->check(WholeNumber(0, "no episode's number, counted from 0"));
  verb.add_option("--slots", options->slots,
                  "Simulators at once (default: as server.json says, one for each processor)")
      ->check(CLI::Range(1, 64));
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/replay.json)");
  AddDaemonOptions(verb, options->daemon);
  AddHostOptions(verb, options->host);
  return [options] { return Replay(*options); };
}

}  // namespace myograde::server
