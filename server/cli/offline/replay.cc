// myograde replay
#include <algorithm>
#include <iostream>
#include <map>
#include <memory>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/play_logs.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/proof/logs.h"

namespace myograde::server {
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

absl::Status Collect(const Client& client, const Json& evaluation, int64_t episode,
                     const std::string& folder, Collected& collected) {
  absl::StatusOr<FetchedLog> fetched = FetchLog(client, evaluation, episode, folder);
  if (absl::IsDataLoss(fetched.status())) {
    collected.records[episode] = Unplayable(episode, fetched.status());
    return absl::OkStatus();
  }
  if (!fetched.ok()) return fetched.status();
  collected.files[episode] = std::move(fetched->file);
  return absl::OkStatus();
}

// The logs that are needed to play `episode`: of all (-1), its own, or those of its lease until it.
absl::StatusOr<Collected> CollectOfSubmission(int64_t episode, const Client& client,
                                              const Json& evaluation, const std::string& folder) {
  Collected collected;
  if (episode < 0) {
    for (const Json& row : evaluation["episode_rows"]) {
      RETURN_IF_ERROR(
          Collect(client, evaluation, row.value("index", int64_t{-1}), folder, collected));
    }
    return collected;
  }
  RETURN_IF_ERROR(Collect(client, evaluation, episode, folder, collected));
  if (collected.files.empty()) return collected;
  const TrackConfig& track = collected.files.begin()->second.header.track;
  if (!CarriesOver(track)) return collected;
  for (int64_t before = FirstOfLease(track, episode); before < episode; ++before) {
    RETURN_IF_ERROR(Collect(client, evaluation, before, folder, collected));
  }
  return collected;
}

Json RecordToJson(const ReplayRecord& record) {
  return {{"index", record.episode},   {"equal", record.equal},
          {"steps", record.steps},     {"step", record.step < 0 ? Json() : Json(record.step)},
          {"differs", record.differs}, {"detail", TextOrNull(record.detail)}};
}

int ReportReplay(const ReplayOptions& options, Json head,
                 const std::vector<ReplayRecord>& records) {
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
  if (options.episode >= 0) {
    return absl::InvalidArgumentError(
        "--episode: a log file holds one episode; leave the option out");
  }
  return ReplayFile(options);
}

}  // namespace

Action AddReplay(CLI::App& verb) {
  auto options = std::make_shared<ReplayOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "Only this one, counted from 0 (default: all)")
      ->check(WholeNumber(0, "no episode's number, counted from 0"));
  AddSimulatorSlots(verb, options->slots);
  AddDaemonOptions(verb, "replay", *options);
  AddHostOptions(verb, options->host);
  return [options] { return Replay(*options); };
}

}  // namespace myograde::server
