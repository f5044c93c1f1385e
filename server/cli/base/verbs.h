// The verbs, and what all of them share: how a verb ends, results as text, the options that several
// have, and what is wrong with a command line.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/cli/terminal/terminal.h"

namespace myograde::server {

// README.md lists them for users.
enum Exit : int {
  kDone = 0,         // a policy that scores 0 of 100 is done
  kNoScore = 1,      // ended without a score, or a difference was found
  kWrongUse = 2,     // arguments, files or ids that can't be used
  kUnreachable = 3,  // no daemon answers
  kTrouble = 4,      // the grader or its host
  kIncomplete = 5,   // nothing wrong was found, and not everything could be checked
};

// What a verb does once its arguments are parsed; returns the exit status, or an error to report.
using Command = std::function<absl::StatusOr<int>()>;

// Statuses of this tool's own functions: kUnavailable means that no daemon answers;
// InvalidArgument, NotFound, FailedPrecondition and OutOfRange are the user's to correct;
// everything else is trouble of the grader or its host.
int ExitOf(const absl::Status& status);

// Prints "myograde: error: ..." on standard error and returns ExitOf(status).
int ReportError(const absl::Status& status);

// A status of another part on this host: what is not the user's to correct becomes kInternal, as
// kUnavailable here means a silent daemon only. `what` goes in front.
absl::Status HostStatus(std::string_view what, const absl::Status& status);
template <typename T>
absl::StatusOr<T> HostStatus(std::string_view what, absl::StatusOr<T> result) {
  if (!result.ok()) return HostStatus(what, result.status());
  return result;
}

// For a verb that reads a log: reports that it is damaged, which is not trouble of the host, and
// returns kNoScore; returns any other error.
absl::StatusOr<int> ExitOfLogError(const absl::Status& status);

// From now on SIGINT, SIGTERM and SIGHUP do not end the process but make StopRequested true; system
// calls that wait return early.
void CatchStopSignals();

bool StopRequested();

// `json` as indented text. Invalid UTF-8 becomes U+FFFD; characters that a terminal would
// obey or not show (plain_text.h) are escaped, so the value is the same.
std::string ShownJson(const Json& json);

// Prints ShownJson on standard output, and a newline.
void PrintJson(const Json& json);

using AnswerPrinter = std::function<void(const Json& answer)>;

// Prints `text`, Filled (terminal.h) from the answer, as a line; or `unchanged`, if it is not empty
// and the answer's "changed" is false.
AnswerPrinter Sentence(std::string text, std::string unchanged = "");

// Ends a verb that has one answer to print: as JSON if `json`, else by `print`. Returns `exit`, or
// the error instead of an answer.
absl::StatusOr<int> PrintAnswer(const absl::StatusOr<Json>& answer, bool json,
                                const AnswerPrinter& print, int exit = kDone);

// Aggregate, outcomes, what the policy printed last, and hashes, their first digits unless
// `full_hashes`. `result` has the keys of an evaluation in server/api/ADDRESSES.md.
void PrintResult(const Json& result, bool full_hashes);

// A column for each of the API's `metrics` (name, title, unit, digits), of objects with their
// values.
std::vector<RowColumn> MetricColumns(const Json& metrics);

// One line for each episode of the array `rows`, then the faults in words. `metrics` are those of
// the result.
void PrintEpisodes(const Json& rows, const Json& metrics, bool full_hashes);

// Why episodes of the array `rows` ended by a fault, in words.
void PrintFaults(const Json& rows);

// What the API could not show (`unreadable` of `answer`), one line each.
void PrintUnreadable(const Json& answer);

// The rows of `answer` at `key` as a table, or the sentence `none` if there are none.
void PrintList(const Json& answer, const std::string& key, const std::string& none,
               const std::vector<RowColumn>& columns);

// Checks with "name", "state", "found" and "todo" as a table; then, state by state of `states`,
// those with something to do: `before`, name and state, and `advice` as Filled makes it.
void PrintChecks(const Json& checks, std::initializer_list<const char*> states, const char* before,
                 const char* advice);

// "31/100 episodes, 4 successes" of the counts in `episodes` of a submission.
std::string CountsText(const Json& submission);

// A check of options that are whole numbers from `least` on; `what` is part of the error: "not an
// episode's number".
CLI::Validator WholeNumber(int64_t least, const std::string& what);

// Whether `text` is 1 to `most` letters, digits, ".", "_" and "-", and begins with a letter or a
// digit or, if `any_first`, with any of them.
bool IsSimpleName(const std::string& text, size_t most, bool any_first = false);

// The two numbers of "A..B"; nullopt for any other text.
std::optional<std::pair<int64_t, int64_t>> ParseRange(const std::string& text);

// Options that can't be used together: InvalidArgumentError with the first sentence whose condition
// is true.
absl::Status RefuseIf(std::initializer_list<std::pair<bool, std::string>> mistakes);

// Adds --json; the output is described by configs/schema/SCHEMA.json.
void AddJson(CLI::App& verb, const std::string& schema, bool& json,
             const std::string& help = "Print JSON");

void AddFullHashes(CLI::App& verb, bool& full);

// Where the data folder and its socket are. Each takes the value of its option, "" if not given.
std::string DataDir(const std::string& option);  // --data, MYOGRADE_DATA, or the default
std::string SocketPath(const std::string& socket_option, const std::string& data_option);

// Where this host's configs and models are.
struct HostOptions {
  std::string configs;
  std::string cache;

  std::string configs_dir() const;
  std::string cache_dir() const;  // --cache, MYOGRADE_CACHE, or the default
};

void AddHostOptions(CLI::App& verb, HostOptions& options);

// Adds the path of a submission, called `name` in the help.
void AddPolicyPath(CLI::App& verb, const std::string& name, std::string& path);

// The chosen verb, once the command line is parsed; empty before.
Command& Chosen();

// "myograde board rejudge", the whole command.
std::string CommandOf(const CLI::App& verb);

// The parts of a verb, such as "team create" and "team list", which share their options.
template <typename Options>
class Parts {
 public:
  explicit Parts(CLI::App& verb) : verb_(verb) { verb_.require_subcommand(1); }

  // `example` is what follows the verb: "create NAME".
  CLI::App* Add(const std::string& name, const std::string& does, const std::string& example,
                std::function<absl::StatusOr<int>(const Options&)> action) {
    CLI::App* part = verb_.add_subcommand(name, does)->group("Subcommands");
    part->footer(absl::StrCat("Example:\n  ", CommandOf(verb_), " ", example));
    part->callback([options = options_, action = std::move(action)] {
      Chosen() = [options, action] { return action(*options); };
    });
    return part;
  }

  Options& options() { return *options_; }

 private:
  CLI::App& verb_;
  std::shared_ptr<Options> options_ = std::make_shared<Options>();
};

// The candidate that is nearest to `word` by inserted, omitted, changed and swapped letters (at
// most one in three), or else begins with `word`; "" if there is none or more than one.
std::string FindNearest(std::string_view word, const std::vector<std::string>& candidates);

// One sentence on `mistake`, the error of parsing `words`, with the verb or option that was
// probably meant or the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& mistake,
                       const std::vector<std::string>& words);

// Each adds its options to `verb` and returns what it does; {}: its parts do. Those of ../client:
Command AddStatus(CLI::App& verb);
Command AddCancel(CLI::App& verb);
Command AddChoose(CLI::App& verb);
Command AddPhase(CLI::App& verb);
Command AddLeaderboard(CLI::App& verb);
Command AddShow(CLI::App& verb);
Command AddRerun(CLI::App& verb);
Command AddRejudge(CLI::App& verb);
Command AddEvaluate(CLI::App& verb);
Command AddQuota(CLI::App& verb);
Command AddHide(CLI::App& verb);
Command AddUnhide(CLI::App& verb);
Command AddDisqualify(CLI::App& verb);
Command AddReinstate(CLI::App& verb);
Command AddBaseline(CLI::App& verb);
Command AddGrant(CLI::App& verb);
Command AddExplain(CLI::App& verb);
Command AddRebuild(CLI::App& verb);
Command AddEvents(CLI::App& verb);
Command AddLog(CLI::App& verb);
Command AddReceipt(CLI::App& verb);
Command AddRecord(CLI::App& verb);
Command AddKey(CLI::App& verb);
Command AddTeam(CLI::App& verb);
Command AddToken(CLI::App& verb);
Command AddLogin(CLI::App& verb);
Command AddLogout(CLI::App& verb);
Command AddCluster(CLI::App& verb);
Command AddWebhook(CLI::App& verb);
Command AddWhoami(CLI::App& verb);
// Those of ../offline:
Command AddServe(CLI::App& verb);
Command AddSubmit(CLI::App& verb);
Command AddExport(CLI::App& verb);
Command AddBackup(CLI::App& verb);
Command AddImport(CLI::App& verb);
Command AddPlot(CLI::App& verb);
Command AddRender(CLI::App& verb);
Command AddReplay(CLI::App& verb);
Command AddReport(CLI::App& verb);
Command AddVerify(CLI::App& verb);
Command AddChallenge(CLI::App& verb);
Command AddSeeds(CLI::App& verb);
Command AddRelease(CLI::App& verb);
Command AddLocal(CLI::App& verb);
Command AddTry(CLI::App& verb);
Command AddNew(CLI::App& verb);
Command AddRuntime(CLI::App& verb);
Command AddSpec(CLI::App& verb);
Command AddDoctor(CLI::App& verb);

}  // namespace myograde::server
