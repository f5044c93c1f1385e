// What all verbs of the command line tool share: exit statuses, options, paths
// and the way mistakes are told.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>
#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// Exit statuses; README.md lists them for users.
enum Exit : int {
  kDone = 0,         // a policy that scores 0 of 100 is done
  kNoScore = 1,      // ended without a score, or a difference was found
  kWrongUse = 2,     // arguments, files or ids that can't be used
  kUnreachable = 3,  // no daemon answers
  kTrouble = 4,      // the grader or its host
};

// What a verb does once its arguments are parsed; returns the exit status.
using Action = std::function<int()>;

// Statuses of this tool's own functions: kUnavailable means that no daemon
// answers, InvalidArgument, NotFound, FailedPrecondition and OutOfRange are the
// user's to mend, everything else is trouble of the grader or its host.
int ExitOf(const absl::Status& status);

// Prints "myograde: error: ..." on standard error and returns ExitOf(status).
int Complain(const absl::Status& status);

// A status of another part on this host: what is not the user's to mend becomes
// kInternal, as only a silent daemon is kUnavailable here. `what` goes in front.
absl::Status HostStatus(std::string_view what, const absl::Status& status);

// Prints one JSON value, indented, and a newline.
void PrintJson(const nlohmann::json& json);

// Where things are; every function takes the option's value, "" if not given.
std::string DataDir(const std::string& option);    // --data, MYOGRADE_DATA, or the default
std::string CacheDir(const std::string& option);   // --cache, MYOGRADE_CACHE, or the default
std::string SocketPath(const std::string& socket_option, const std::string& data_option);

// Adds --data and --socket.
struct ApiOptions {
  std::string data;
  std::string socket;
  std::string path() const { return SocketPath(socket, data); }
};
void AddDaemonOptions(CLI::App& verb, ApiOptions& options);

// A check of options that are whole numbers from `least` on; `what` says in the error what the
// text is not: "no episode".
CLI::Validator WholeNumber(int64_t least, const std::string& what);

// Adds ID, the number of a submission.
void AddSubmissionId(CLI::App& verb, int64_t& id, bool required = true,
                     const std::string& help = "The submission");

// Adds --full-hashes.
void AddFullHashes(CLI::App& verb, bool& full);

// Adds --configs and --cache.
struct HostOptions {
  std::string configs;
  std::string cache;
  std::string configs_dir() const;
  std::string cache_dir() const { return CacheDir(cache); }
};
void AddHostOptions(CLI::App& verb, HostOptions& options);

// Reads a seed list: whole numbers from 0 to 2^63-1 without repetition, 1 to
// 10,000 of them, as ParseSeeds takes them in JSON or one a line ('#' begins a
// comment).
absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path);

// A folder below TMPDIR that is removed with everything in it.
class TempFolder {
 public:
  static absl::StatusOr<TempFolder> Make(const std::string& purpose);
  TempFolder(TempFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  ~TempFolder();
  const std::string& path() const { return path_; }

 private:
  explicit TempFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

// The verbs; each adds its options to `verb` and returns what it does.
Action AddServe(CLI::App& verb);
Action AddSubmit(CLI::App& verb);
Action AddStatus(CLI::App& verb);
Action AddCancel(CLI::App& verb);
Action AddLeaderboard(CLI::App& verb);
Action AddShow(CLI::App& verb);
Action AddQuota(CLI::App& verb);
Action AddHide(CLI::App& verb);
Action AddUnhide(CLI::App& verb);
Action AddDisqualify(CLI::App& verb);
Action AddBaseline(CLI::App& verb);
Action AddExport(CLI::App& verb);
Action AddImport(CLI::App& verb);
Action AddBackup(CLI::App& verb);
Action AddRerun(CLI::App& verb);
Action AddLog(CLI::App& verb);
Action AddReplay(CLI::App& verb);
Action AddReceipt(CLI::App& verb);
Action AddVerify(CLI::App& verb);
Action AddKey(CLI::App& verb);
Action AddSeeds(CLI::App& verb);
Action AddLocal(CLI::App& verb);
Action AddSpec(CLI::App& verb);
Action AddDoctor(CLI::App& verb);

}  // namespace myograde::server
