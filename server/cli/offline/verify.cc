// myograde verify
#include <absl/strings/str_cat.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/artefact/adapters.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/offline/play_logs.h"
#include "server/cli/offline/seeds.h"
#include "server/cli/offline/verify_record.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/grader_build.h"
#include "server/proof/logs.h"
#include "server/proof/receipt.h"
#include "server/proof/seed_list.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

// Why the file at `path`, with that hash, is not one of the receipt's.
std::string UnknownText(const std::string& path, const std::string& hash) {
  const absl::StatusOr<EpisodeLog> log = ParseLog(ReadLog(path));
  if (!log.ok()) return std::string(log.status().message());
  return absl::StrCat("the log of episode ", log->header.episode, " has the SHA-256 ", hash,
                      ", which is not in the receipt");
}

absl::StatusOr<std::string> ReadAs(const std::string& hash, const std::string& path) {
  absl::StatusOr<std::string> log = ReadLog(path);
  if (log.ok() && Sha256Hex(*log) != hash) {
    return absl::DataLossError(absl::StrCat(path, ": was altered: its SHA-256 is ", Sha256Hex(*log),
                                            ", in the receipt it is ", hash));
  }
  return log;
}

// Finds logs by the hash of their content: in the files and folders `given`, or at the daemon if
// none are. What is found is checked against the hash, so it need not be trusted.
class LogSource {
 public:
  LogSource(const std::vector<std::string>& given, Client client)
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

  // One check for each file that was given: files that can't be read, and those that the receipt
  // does not name because they were altered or belong to another evaluation, are not valid.
  std::vector<ReceiptCheck> Check(const Json& receipt) const {
    std::vector<ReceiptCheck> checks = unreadable_;
    for (const auto& [hash, path] : files_) {
      const bool named = RowWith(receipt["episodes"], "log", hash).is_object();
      checks.push_back({absl::StrCat("log ", hash), named, named ? "" : UnknownText(path, hash)});
    }
    return checks;
  }

  // The log of that SHA-256. NotFoundError if it is not among those given, DataLossError if it was
  // altered, or the daemon's error.
  absl::StatusOr<std::string> Find(const std::string& hash) const {
    if (!given_) return FetchLogBytes(client_, hash);
    if (const auto it = files_.find(hash); it != files_.end()) return ReadAs(hash, it->second);
    for (const std::string& folder : folders_) {
      const std::string path = absl::StrCat(folder, "/", LogFileName(hash));
      if (std::filesystem::exists(path)) return ReadAs(hash, path);
    }
    return absl::NotFoundError(absl::StrCat("the log ", hash, " is not among those of --logs"));
  }

 private:
  const Client client_;
  std::vector<std::string> folders_;
  std::map<std::string, std::string> files_;  // paths, by the hash of what is in them
  std::vector<ReceiptCheck> unreadable_;
  const bool given_;
};

// Of a receipt of the longest evaluation, 10,000 episodes, 7 million are needed.
constexpr size_t kMaxReceiptBytes = 16u << 20;
constexpr size_t kMaxKeyBytes = 4096;

struct VerifyOptions : DaemonOptions {
  HostOptions host;
  std::string file;
  std::string key;
  std::string secret;             // of the phase: its digits, or a file of them; "": ask the daemon
  std::vector<std::string> logs;  // files of logs, or folders of them
  int64_t resimulate = 0;
  int slots = 0;                  // 0: as server.json says
  std::string folder;             // of a whole record; "": a receipt is verified
  std::string head;               // file of an earlier head; "": none
};

// `count` different episodes, at random, so that nobody can know which will be looked at.
std::set<int64_t> Sample(int64_t episodes, int64_t count) {
  std::vector<int64_t> all(static_cast<size_t>(episodes));
  std::iota(all.begin(), all.end(), 0);
  std::set<int64_t> chosen;
  std::sample(all.begin(), all.end(), std::inserter(chosen, chosen.end()), count,
              std::random_device());
  return chosen;
}

Json Played(int64_t episode, bool equal, const Json& step, const std::string& detail) {
  return {{"index", episode}, {"equal", equal}, {"step", step}, {"detail", TextOrNull(detail)}};
}

// The sampled episodes played again: each log must be the one that the receipt names, and end in
// the digest of the states that it names.
absl::StatusOr<Json> Resimulate(const VerifyOptions& options, const Json& receipt,
                                const LogSource& source) {
  ASSIGN_OR_RETURN(TempFolder temp, TempFolder::Make("verify"));
  ASSIGN_OR_RETURN(TrackConfig track, ParseTrackConfig(receipt["track_config"], "track_config"));
  const Json& episodes = receipt["episodes"];
  const std::set<int64_t> sample = Sample(std::ssize(episodes), options.resimulate);
  std::set<int64_t> needed = sample;
  for (const int64_t episode : sample) {
    for (int64_t i = FirstNeeded(track, episode); i < episode; ++i) needed.insert(i);
  }
  std::map<int64_t, ReplayLogFile> files;
  std::map<int64_t, Json> outcomes;
  for (const int64_t episode : needed) {
    const Json& named = episodes[static_cast<size_t>(episode)];
    const Json hash = named.value("log", Json());
    const absl::StatusOr<std::string> bytes =
        hash.is_string() ? source.Find(hash)
                         : absl::FailedPreconditionError("the receipt has no log of it");
    absl::StatusOr<EpisodeLog> log = ParseLog(bytes);
    if (log.ok() && (log->header.config != receipt["config"] || log->header.episode != episode ||
                     log->end.digest != named.value("digest", ""))) {
      log = absl::DataLossError("its log is of a different episode than the receipt's");
    }
    if (!log.ok()) {
      outcomes[episode] = Played(episode, false, nullptr, std::string(log.status().message()));
      continue;
    }
    ASSIGN_OR_RETURN(files[episode], SaveLog(temp.path(), *bytes, std::move(log->header)));
  }
  ASSIGN_OR_RETURN(std::vector<ReplayRecord> records, PlayLogs(files, options.host, options.slots));
  for (const ReplayRecord& record : records) {
    outcomes[record.episode] =
        Played(record.episode, record.equal, record.step < 0 ? Json() : Json(record.step),
                record.detail);
  }
  Json list = Json::array();
  for (const auto& [episode, outcome] : outcomes) {
    if (sample.contains(episode)) list.push_back(outcome);
  }
  return list;
}

Json ReceiptChecksJson(const std::vector<ReceiptCheck>& checks) {
  Json list = Json::array();
  for (const ReceiptCheck& check : checks) {
    list.push_back(
        {{"name", check.name}, {"valid", check.valid}, {"detail", TextOrNull(check.detail)}});
  }
  return list;
}

void PrintReceiptChecks(const std::vector<ReceiptCheck>& checks) {
  for (const ReceiptCheck& check : checks) {
    const std::string detail = Sanitized(check.detail);
    std::cout << Sanitized(check.name) << ": "
              << (!check.valid     ? "WRONG: " + detail
                  : detail.empty() ? "good"
                                   : "note: " + detail)
              << '\n';
  }
}

bool AllValid(const std::vector<ReceiptCheck>& checks) {
  return std::all_of(checks.begin(), checks.end(),
                     [](const ReceiptCheck& check) { return check.valid; });
}

absl::StatusOr<int> ReportVerified(const VerifyOptions& options, const Json& receipt,
                                   const std::vector<ReceiptCheck>& checks,
                                   const Json& resimulated) {
  bool valid = AllValid(checks);
  for (const Json& entry : resimulated) valid = valid && entry["equal"].get<bool>();
  const Json root = receipt.is_object() ? receipt.value("merkle_root", Json()) : Json();
  return PrintAnswer(
      Json{{"file", options.file},
           {"valid", valid},
           {"merkle_root", root},
           {"checks", ReceiptChecksJson(checks)},
           {"resimulated", resimulated}},
      options.json,
      [&](const Json&) {
        PrintReceiptChecks(checks);
        for (const Json& entry : resimulated) {
          std::cout << Filled(entry, entry["equal"]
                                         ? "episode {index}: matches the receipt\n"
                                         : "episode {index}: DIFFERS: {detail}\n");
        }
        std::cout << Bold(valid ? "The receipt holds." : "The receipt does not hold.") << std::endl;
      },
      valid ? kDone : kNoScore);
}

// The phase's secret, "" if the receipt needs none or nobody knows it yet. What a daemon says need not
// be trusted: the receipt holds the commitment to it.
absl::StatusOr<std::string> SecretFor(const VerifyOptions& options, const Json& receipt) {
  if (!HidesSeeds(receipt)) {
    if (options.secret.empty()) return "";
    return absl::InvalidArgumentError(
        "--secret: the seeds of this receipt are public; leave it out");
  }
  if (!options.secret.empty()) return GivenSecret(options.secret);
  const std::string phase = receipt["track_config"]["phase"];
  const absl::StatusOr<Json> known = FindPhaseOf(options.client(), phase);
  const Json seeds = known.ok() ? known->value("seeds", Json::object()) : Json::object();
  return SecretOfDigits(TextAt(seeds, "secret"), "the daemon's answer").value_or("");
}

void PrintRecordReport(const RecordReport& report) {
  PrintReceiptChecks(report.checks);
  if (report.valid()) {
    for (const std::string& what : report.not_checked) std::cout << "not checked: " << what << '\n';
    std::cout << Counted(report.size, "entry", "entries") << ", "
              << Counted(report.receipts, "receipt") << " (" << report.withheld << " withheld), "
              << Counted(report.boards, "board") << ", root " << report.root << '\n';
  }
  std::cout << Bold(!report.valid()              ? "The record does not hold."
                    : report.not_checked.empty() ? "The record holds."
                                                 : "Nothing wrong was found, and the check is "
                                                   "incomplete.")
            << std::endl;
}

absl::StatusOr<int> VerifyAll(const VerifyOptions& options, const PublicKey& key) {
  ASSIGN_OR_RETURN(const std::string pem, ReadFile(options.key, kMaxKeyBytes));
  std::optional<std::string> earlier;
  if (!options.head.empty()) {
    ASSIGN_OR_RETURN(earlier, ReadFile(options.head, kMaxKeyBytes));
  }
  const absl::StatusOr<RecordFolder> folder = RecordFolder::Open(options.folder);
  if (absl::IsNotFound(folder.status())) return folder.status();
  RecordReport report;
  if (folder.ok()) {
    Progress progress("receipts");
    report = RecordVerifier(*folder, pem, key, progress.Listener()).Run(earlier);
  } else {
    report.checks.push_back({"folder", false, std::string(folder.status().message())});
  }
  const bool complete = report.valid() && report.not_checked.empty();
  return PrintAnswer(Json{{"folder", options.folder},
                          {"valid", report.valid()},
                          {"complete", complete},
                          {"checks", ReceiptChecksJson(report.checks)},
                          {"not_checked", report.not_checked},
                          {"size", report.size},
                          {"root", TextOrNull(report.root)},
                          {"receipts", report.receipts},
                          {"withheld", report.withheld},
                          {"boards", report.boards}},
                     options.json, [&](const Json&) { PrintRecordReport(report); },
                     complete ? kDone : report.valid() ? kIncomplete : kNoScore);
}

absl::StatusOr<int> Verify(const VerifyOptions& options) {
  RETURN_IF_ERROR(RefuseIf(
      {{options.file.empty() == options.folder.empty(),
        "give a receipt's file, or --all with the folder of a whole record"},
       {options.key.empty(),
        "--key: give the file of the organiser's published key; without it, anybody could have "
        "made the receipt"}}));
  ASSIGN_OR_RETURN(const PublicKey key, PublicKey::Read(options.key));
  if (!options.folder.empty()) return VerifyAll(options, key);
  const absl::StatusOr<std::string> text = ReadFile(options.file, kMaxReceiptBytes);
  if (absl::IsInvalidArgument(text.status())) {
    return absl::InvalidArgumentError(
        absl::StrCat(text.status().message(), ", so it is not a receipt"));
  }
  if (!text.ok()) return text.status();
  const absl::StatusOr<Json> receipt = ParseReceipt(*text);
  if (!receipt.ok()) {
    return ReportVerified(options, nullptr,
                          {{"format", false, std::string(receipt.status().message())}},
                          Json::array());
  }
  ASSIGN_OR_RETURN(const std::string secret, SecretFor(options, *receipt));
  std::vector<ReceiptCheck> checks = CheckReceipt(*text, key, secret);
  const LogSource source(options.logs, options.client());
  for (ReceiptCheck& check : source.Check(*receipt)) checks.push_back(std::move(check));
  Json resimulated = Json::array();
  if (options.resimulate > 0 && AllValid(checks)) {
    const Json grader = GraderBuild(options.host.cache_dir(), AdapterNames());
    for (ReceiptCheck& check : CompareGraders(*receipt, grader)) {
      checks.push_back(std::move(check));
    }
    if (!AllValid(checks)) return ReportVerified(options, *receipt, checks, resimulated);
    if (HidesSeeds(*receipt) && secret.empty()) {
      return absl::InvalidArgumentError(
          "--resimulate: needs the phase's seeds, which are not revealed yet; once they are, give "
          "--secret");
    }
    ASSIGN_OR_RETURN(const Json whole,
                     HidesSeeds(*receipt) ? OpenedReceipt(*receipt, secret) : *receipt);
    ASSIGN_OR_RETURN(resimulated, Resimulate(options, whole, source));
  }
  return ReportVerified(options, *receipt, checks, resimulated);
}

}  // namespace

Command AddVerify(CLI::App& verb) {
  auto options = std::make_shared<VerifyOptions>();
  CLI::Option* file = verb.add_option("RECEIPT", options->file, "The receipt's file");
  CLI::Option* all =
      verb.add_option("--all", options->folder,
                      "Check a whole record with its receipts and boards: the folder that "
                      "\"myograde proof record export\" wrote")
          ->excludes(file);
  verb.add_option("--head", options->head,
                  "With --all: an earlier head of the record that you kept; the record must "
                  "continue it")
      ->needs(all);
  verb.add_option("--key", options->key,
                  "File of the organiser's published key (\"myograde proof key\"); required, "
                  "because a key inside a receipt would prove nothing");
  verb.add_option("--secret", options->secret,
                  "For a phase with hidden seeds, once they are revealed: the phase's secret in "
                  "hexadecimal, or a file with it (default: ask the daemon)");
  verb.add_option("--resimulate", options->resimulate,
                  "Simulate this many randomly chosen episodes again from their logs")
      ->check(CLI::Range(1, 10'000));
  verb.add_option("--logs,--log", options->logs,
                  "Log files, or folders of them; each is checked against the receipt (default: "
                  "ask the daemon for the logs)");
  AddSimulatorSlots(verb, options->slots);
  AddDaemonOptions(verb, "verify", *options);
  AddHostOptions(verb, options->host);
  return [options] { return Verify(*options); };
}

}  // namespace myograde::server
