// myograde verify
#include <openssl/rand.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/logs_of.h"
#include "server/cli/replay.h"
#include "server/cli/terminal.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/proof/receipt.h"
#include "server/proof/unpack_log.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Of a receipt of the longest evaluation, 10,000 episodes, 7 million are needed.
constexpr size_t kMaxReceiptBytes = 16u << 20;

struct VerifyOptions {
  ApiOptions daemon;
  HostOptions host;
  std::string file;
  std::string key;
  std::vector<std::string> logs;  // files of logs, or folders of them
  int64_t resimulate = 0;
  int slots = 0;
  bool json = false;
};

// Finds logs by the hash of their content, in the files and folders that were given, else at the
// daemon. What is found is held against the hash, so it need not be trusted.
class LogSource {
 public:
  explicit LogSource(const VerifyOptions& options) : client_(options.daemon.path()) {
    for (const std::string& path : options.logs) {
      if (std::filesystem::is_directory(path)) {
        folders_.push_back(path);
      } else if (absl::StatusOr<std::string> log = ReadLog(path); log.ok()) {
        files_[Sha256Hex(*log)] = path;
      } else {
        checks_.push_back({"log " + path, false, std::string(log.status().message())});
      }
    }
    given_ = !options.logs.empty();
  }

  // Files that the receipt does not know are altered, or of another evaluation.
  std::vector<ReceiptCheck> Check(const Json& receipt) const {
    std::vector<ReceiptCheck> checks = checks_;
    for (const auto& [hash, path] : files_) {
      bool known = false;
      for (const Json& entry : receipt["episodes"]) {
        known = known || entry.value("log", Json()) == Json(hash);
      }
      ReceiptCheck check = {absl::StrCat("log ", hash), known, ""};
      if (!known) {
        const absl::StatusOr<std::string> log = ReadLog(path);
        const absl::StatusOr<EpisodeLog> parsed =
            log.ok() ? ParseEpisodeLog(*log) : absl::StatusOr<EpisodeLog>(log.status());
        check.detail = parsed.ok()
                           ? absl::StrCat("the log of episode ", parsed->header.episode,
                                          " has the SHA-256 ", hash,
                                          ", which the receipt does not name")
                           : std::string(parsed.status().message());
      }
      checks.push_back(std::move(check));
    }
    return checks;
  }

  absl::StatusOr<std::string> Find(const std::string& hash) const {
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

 private:
  static absl::StatusOr<std::string> ReadAs(const std::string& hash, const std::string& path) {
    absl::StatusOr<std::string> log = ReadLog(path);
    if (log.ok() && Sha256Hex(*log) != hash) {
      return absl::DataLossError(absl::StrCat(path, ": was altered: its SHA-256 is ",
                                              Sha256Hex(*log), ", the receipt says ", hash));
    }
    return log;
  }

  const Client client_;
  std::vector<std::string> folders_;
  std::map<std::string, std::string> files_;  // paths, by the hash of what is in them
  std::vector<ReceiptCheck> checks_;
  bool given_ = false;
};

// `count` different episodes, at random, so that nobody can know which will be looked at.
std::set<size_t> Sample(size_t episodes, size_t count) {
  std::set<size_t> chosen;
  while (chosen.size() < std::min(count, episodes)) {
    uint64_t random = 0;
    RAND_bytes(reinterpret_cast<unsigned char*>(&random), sizeof(random));
    chosen.insert(random % episodes);
  }
  return chosen;
}

Json Played(int64_t episode, bool equal, const Json& step, const std::string& detail) {
  return {{"index", episode},
          {"equal", equal},
          {"step", step},
          {"detail", detail.empty() ? Json() : Json(detail)}};
}

// The sampled episodes played again: each log must be the one that the receipt names, and end in
// the digest of the states that it names.
absl::StatusOr<Json> Resimulate(const VerifyOptions& options, const Json& receipt,
                                const LogSource& source) {
  absl::StatusOr<TempFolder> temp = TempFolder::Make("verify");
  if (!temp.ok()) return temp.status();
  absl::StatusOr<TrackConfig> track = ParseTrackConfig(receipt["track_config"], "track_config");
  if (!track.ok()) return track.status();
  const Json& episodes = receipt["episodes"];
  std::set<size_t> sample = Sample(episodes.size(), static_cast<size_t>(options.resimulate));
  // Where state carries over, an episode needs those before it in its lease.
  std::set<size_t> needed = sample;
  if (track->rules.value("one_environment", false)) {
    for (const size_t index : sample) {
      const auto lease = static_cast<size_t>(track->episodes_per_lease);
      for (size_t i = index - index % lease; i < index; ++i) needed.insert(i);
    }
  }
  std::map<int64_t, ReplayLogFile> files;
  std::map<int64_t, Json> outcomes;
  for (const size_t index : needed) {
    const auto episode = static_cast<int64_t>(index);
    const Json hash = episodes[index].value("log", Json());
    absl::StatusOr<std::string> bytes =
        hash.is_string() ? source.Find(hash)
                         : absl::FailedPreconditionError("the receipt names no log of it");
    absl::StatusOr<EpisodeLog> log =
        bytes.ok() ? ParseEpisodeLog(*bytes) : absl::StatusOr<EpisodeLog>(bytes.status());
    if (log.ok() && (log->header.config != receipt["config"] || log->header.episode != episode ||
                     log->end.digest != episodes[index].value("digest", ""))) {
      log = absl::DataLossError("its log tells of another episode than the receipt");
    }
    if (!log.ok()) {
      outcomes[episode] = Played(episode, false, nullptr, std::string(log.status().message()));
      continue;
    }
    const std::string path = absl::StrCat(temp->path(), "/", episode, ".lcmlog");
    std::ofstream file(path, std::ios::binary);
    file << *bytes;
    file.close();
    if (!file) return absl::InternalError(path + ": can't be written; is the disk full?");
    files[episode] = {path, std::move(log->header)};
  }
  absl::StatusOr<std::vector<ReplayRecord>> records = PlayLogs(files, options.host, options.slots);
  if (!records.ok()) return records.status();
  for (const ReplayRecord& record : *records) {
    outcomes[record.episode] =
        Played(record.episode, record.equal, record.step < 0 ? Json() : Json(record.step),
                record.detail);
  }
  Json list = Json::array();
  for (const auto& [episode, outcome] : outcomes) {
    if (sample.contains(static_cast<size_t>(episode))) list.push_back(outcome);
  }
  return list;
}

int Report(const VerifyOptions& options, const Json& receipt,
           const std::vector<ReceiptCheck>& checks, const Json& resimulated) {
  bool valid = true;
  Json list = Json::array();
  for (const ReceiptCheck& check : checks) {
    valid = valid && check.valid;
    list.push_back({{"name", check.name},
                    {"valid", check.valid},
                    {"detail", check.detail.empty() ? Json() : Json(check.detail)}});
  }
  for (const Json& entry : resimulated) valid = valid && entry["equal"].get<bool>();
  if (options.json) {
    PrintJson({{"file", options.file},
               {"valid", valid},
               {"merkle_root", receipt.is_object() ? receipt.value("merkle_root", Json()) : Json()},
               {"checks", list},
               {"resimulated", resimulated}});
    return valid ? kDone : kNoScore;
  }
  for (const Json& check : list) {
    std::cout << Cell(check, "name") << ": "
              << (!check["valid"]            ? "WRONG: " + Cell(check, "detail")
                  : check["detail"].is_null() ? "good"
                                              : "note: " + Cell(check, "detail"))
              << '\n';
  }
  for (const Json& entry : resimulated) {
    std::cout << "episode " << entry["index"] << ": "
              << (entry["equal"] ? "came out as the receipt says"
                                 : "DIFFERS: " + Cell(entry, "detail"))
              << '\n';
  }
  std::cout << Bold(valid ? "The receipt holds." : "The receipt does not hold.") << std::endl;
  return valid ? kDone : kNoScore;
}

int Verify(const VerifyOptions& options) {
  if (options.key.empty()) {
    return Complain(absl::InvalidArgumentError(
        "--key: give the file of the key that the organiser published; without it, anybody could "
        "have made the receipt"));
  }
  const absl::StatusOr<PublicKey> key = PublicKey::Read(options.key);
  if (!key.ok()) return Complain(key.status());
  const absl::StatusOr<std::string> text = ReadFile(options.file, kMaxReceiptBytes);
  if (absl::IsInvalidArgument(text.status())) {
    return Complain(absl::InvalidArgumentError(
        absl::StrCat(text.status().message(), ", so it is no receipt")));
  }
  if (!text.ok()) return Complain(text.status());
  const absl::StatusOr<Json> receipt = ParseReceipt(*text);
  if (!receipt.ok()) {
    return Report(options, nullptr,
                  {{"format", false, std::string(receipt.status().message())}}, Json::array());
  }
  std::vector<ReceiptCheck> checks = CheckReceipt(*text, *key);
  const LogSource source(options);
  for (ReceiptCheck& check : source.Check(*receipt)) checks.push_back(std::move(check));
  Json resimulated = Json::array();
  const bool sound = std::all_of(checks.begin(), checks.end(),
                                 [](const ReceiptCheck& check) { return check.valid; });
  if (options.resimulate > 0 && sound) {
    const Json grader = GraderBuild(options.host.cache_dir());
    for (ReceiptCheck& check : CompareGraders(*receipt, grader)) {
      checks.push_back(std::move(check));
    }
    const bool same_models = std::all_of(checks.begin(), checks.end(),
                                         [](const ReceiptCheck& check) { return check.valid; });
    if (!same_models) return Report(options, *receipt, checks, resimulated);
    absl::StatusOr<Json> list = Resimulate(options, *receipt, source);
    if (!list.ok()) return Complain(list.status());
    resimulated = *std::move(list);
  }
  return Report(options, *receipt, checks, resimulated);
}

}  // namespace

Action AddVerify(CLI::App& verb) {
  auto options = std::make_shared<VerifyOptions>();
  verb.add_option("RECEIPT", options->file, "The receipt's file")->required();
  verb.add_option("--key", options->key,
                  "File of the organiser's published key (\"myograde key\"); required, as a key "
                  "inside a receipt would prove nothing");
  verb.add_option("--resimulate", options->resimulate,
                  "Play so many of the episodes, chosen at random, again from their logs")
      ->check(CLI::Range(1, 10'000));
  verb.add_option("--logs,--log", options->logs,
                  "Files of logs, or folders of them; each is held against the receipt (default: "
                  "the daemon is asked for the logs to play)");
  verb.add_option("--slots", options->slots, "Simulators at once")->check(CLI::Range(1, 64));
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/verify.json)");
  AddDaemonOptions(verb, options->daemon);
  AddHostOptions(verb, options->host);
  return [options] { return Verify(*options); };
}

}  // namespace myograde::server
