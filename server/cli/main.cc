// myograde, the command line tool: the table of its verbs.
#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <clocale>
#include <cstring>
#include <exception>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "protocol/tracks/registry.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

// Headings of the help.
constexpr char kWrite[] = "Write a policy";
constexpr char kSubmit[] = "Submit";
constexpr char kLook[] = "Look closer";
constexpr char kRun[] = "Run a challenge";
constexpr char kProve[] = "Prove";
constexpr char kServe[] = "Run a server";
constexpr char kHidden[] = "";  // a short form, which the help leaves out

struct Verb {
  const char* name;     // "submit", or with the noun that it belongs to, "episode log"
  const char* heading;  // nullptr: listed in the help of its noun
  const char* does;
  const char* example;  // what follows the verb; TRACK is replaced by a track's name
  Command (*add)(CLI::App& verb);  // nullptr: a noun, whose verbs follow
};

constexpr Verb kVerbs[] = {
    {"new", kWrite, "Write a folder with a policy that is ready to run",
     "my_policy --lang python --track TRACK", AddNew},
    {"spec", kWrite, "Print a track's observations, actions, budgets, rules and scoring",
     "--track TRACK --json", AddSpec},
    {"try", kWrite, "Grade some episodes on this host, and write a report and films",
     "./my_policy --track TRACK -o ./try1", AddTry},
    {"local", kWrite, "Grade a policy on this host, without a daemon",
     "./my_policy --track TRACK --episodes 5", AddLocal},
    {"runtime", kWrite, "Build, list and remove the runtimes that policies may ask for",
     "add torch-cpu", AddRuntime},

    {"login", kSubmit, "Log in to a server with a token", "https://grader.example.org:8443",
     AddLogin},
    {"logout", kSubmit, "Remove the login", "", AddLogout},
    {"whoami", kSubmit, "Show your name, role and team on the server", "", AddWhoami},
    {"submit", kSubmit, "Submit a policy for grading",
     "./my_policy --track TRACK --team \"Team Blue\" --wait", AddSubmit},
    {"status", kSubmit, "Show the daemon and its submissions, or the progress of one", "7",
     AddStatus},
    {"show", kSubmit, "Show the result of a submission", "7 --episodes", AddShow},
    {"cancel", kSubmit, "Cancel a queued or running submission", "7", AddCancel},
    {"choose", kSubmit, "Select your team's entry for the board", "7", AddChoose},
    {"quota", kSubmit, "Show how much a team may still submit, and its ledger",
     "--team \"Team Blue\" --track TRACK", AddQuota},
    {"leaderboard", kSubmit, "Show the ranking of the submissions", "--track TRACK",
     AddLeaderboard},

    {"episode", kLook, "Logs, replays, films and reruns of episodes",
     "render 7 --episode 3 -o episode3.mp4", nullptr},
    {"episode log", nullptr, "Write the log of an episode to a file that LCM's tools can read",
     "7 --episode 3 -o episode3.lcmlog", AddLog},
    {"episode replay", nullptr,
     "Simulate episodes again from their logs, without the policy, and compare", "7 --episode 3",
     AddReplay},
    {"episode render", nullptr,
     "Draw an episode from its log: a film, a picture, or a strip of the best and the worst",
     "7 --episode 3 -o episode3.mp4", AddRender},
    {"episode rerun", nullptr, "Run a submission's episodes again and print what differs",
     "7 --episodes 10..19 --verify", AddRerun},
    {"report", kLook, "Write a submission's or a phase's results as one HTML file",
     "7 -o report.html", AddReport},
    {"plot", kLook, "Draw figures of a board or of submissions, as SVG or PDF",
     "survival 7 9 -o survival.svg", AddPlot},

    {"board", kRun, "Explain, rejudge and rebuild boards", "explain 7 9", nullptr},
    {"board explain", nullptr,
     "Explain why one of two submissions (or teams) ranks above the other", "7 9", AddExplain},
    {"board rejudge", nullptr,
     "Compute a board under other rules, see what changes, and apply or drop it",
     "create --track TRACK --config new_rules.json --reason \"The line is 80.\"", AddRejudge},
    {"board evaluate", nullptr, "Play extra episodes to separate statistically tied ranks",
     "--phase final --more-seeds 100", AddEvaluate},
    {"board rebuild", nullptr,
     "Rebuild the boards from the stored episodes, without changing any result", "", AddRebuild},
    {"phase", kRun, "Check, pause and publish phases, and reveal their seeds",
     "pause final --reason \"a slot is broken\"",
     [](CLI::App& verb) {
       AddChallenge(verb);
       return AddPhase(verb);
     }},
    {"phase seeds", nullptr,
     "Commit to a phase's seeds, reveal them after the close, and check them",
     "commit --phase final --secret final.secret", AddSeeds},
    {"submission", kRun, "Hide, disqualify and reinstate submissions",
     "disqualify 7 --reason \"reads the seeds\"", nullptr},
    {"submission hide", nullptr, "Take a submission off the boards", "7 --reason \"wrong file\"",
     AddHide},
    {"submission unhide", nullptr, "Put a hidden submission back on the boards", "7", AddUnhide},
    {"submission disqualify", nullptr,
     "Take a submission out of the ranking and list it apart, with the reason",
     "7 --reason \"reads the seeds\"", AddDisqualify},
    {"submission reinstate", nullptr, "Revoke a disqualification", "7", AddReinstate},
    {"submission baseline", nullptr,
     "Show a submission on the boards for comparison, without a rank", "7", AddBaseline},
    {"team", kRun, "Teams: their names, members, merges, bans and grants",
     "create \"Team Blue\"", AddTeam},
    {"team grant", nullptr, "Let a team submit more, both today and in total",
     "\"Team Blue\" --track TRACK --units 1 --reason \"a broken host\"", AddGrant},
    {"token", kRun, "Create, list and revoke the tokens for access over the network",
     "create --team \"Team Blue\" --label \"Ada's laptop\"", AddToken},
    {"events", kRun, "List denied requests and what organisers did",
     "--kind denied", AddEvents},

    {"proof", kProve, "Receipts, the public record, and signed releases",
     "receipt 7 -o receipt.json", nullptr},
    {"proof receipt", nullptr, "Write the signed receipt of a submission that has ended",
     "7 -o receipt.json", AddReceipt},
    {"proof verify", nullptr, "Check a receipt or a record against the organiser's key",
     "receipt.json --key organiser.pem --resimulate 3 --logs ./logs", AddVerify},
    {"proof record", nullptr,
     "Read, prove and export the public record of all ranked results", "export ./record",
     AddRecord},
    {"proof key", nullptr, "Print the public key for checking receipts",
     "-o organiser.pem", AddKey},
    {"proof release", nullptr,
     "Sign the files of a release, or check those of a downloaded one",
     "verify ./myograde-1.0.0 --key release.pem", AddRelease},

    {"serve", kServe, "Run the daemon; SIGTERM stops it cleanly",
     "--data /srv/myograde", AddServe},
    {"doctor", kServe, "Check what this host lacks for grading, and what that costs",
     "", AddDoctor},
    {"store", kServe, "Export, import and back up the store", "backup /srv/backup/store.db",
     nullptr},
    {"store export", nullptr, "Write the teams, results and boards of the store as JSON or CSV",
     "challenge.json", AddExport},
    {"store import", nullptr, "Load an export into an empty data folder",
     "challenge.json --data /srv/copy", AddImport},
    {"store backup", nullptr, "Copy the store while the daemon runs", "/srv/backup/store.db",
     AddBackup},
    {"webhook", kServe, "List the webhooks of server.json and their deliveries, and test one",
     "test chat", AddWebhook},
    {"cluster", kServe, "List the nodes of the cluster, and drain or readmit one",
     "drain node17 --reason \"a fan is broken\"", AddCluster},
};

constexpr char kStatuses[] =
    "Exit status: 0 done, 1 ended without a score or with a difference found, 2 usage error,\n"
    "3 the daemon can't be reached, 4 the grader or its host is in trouble.";

void AddVerb(CLI::App& app, const Verb& verb) {
  const std::string_view name = verb.name;
  const size_t space = name.find(' ');
  CLI::App* noun =
      space == std::string_view::npos ? &app : app.get_subcommand(std::string(name.substr(0, space)));
  CLI::App* sub = noun->add_subcommand(std::string(name.substr(space + 1)), verb.does);
  sub->group(verb.heading == nullptr ? "Subcommands" : verb.heading);
  const std::string example = absl::StrReplaceAll(verb.example, {{"TRACK", TrackNames().front()}});
  sub->footer(absl::StrCat("Example:\n  ", CommandOf(*sub), example.empty() ? "" : " ", example,
                           "\n\n", kStatuses));
  if (verb.add == nullptr) {
    sub->require_subcommand(1);
  } else if (Command action = verb.add(*sub); action != nullptr) {
    sub->callback([action = std::move(action)] { Chosen() = action; });
  }
}

int Run(int argc, char** argv) {
  CLI::App app("MyoGrade grades policies on the tracks of MyoChallenge and ranks them.",
               "myograde");
  app.set_version_flag("--version", MYOGRADE_VERSION);
  app.footer("\"myograde VERB --help\" describes a verb, with an example.");
  app.require_subcommand(1);
  for (Verb verb : kVerbs) {
    AddVerb(app, verb);
    const std::string_view name = verb.name;
    if (name != "episode rerun" && name != "proof verify") continue;
    verb.name += name.find(' ') + 1;  // "rerun" and "verify" work too
    verb.heading = kHidden;
    AddVerb(app, verb);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    return app.exit(asked);
  } catch (const CLI::ParseError& mistake) {
    const std::vector<std::string> words = {argv + 1, argv + argc};
    return ReportError(absl::InvalidArgumentError(UsageError(app, mistake, words)));
  }
  const absl::StatusOr<int> exit = Chosen()();
  return exit.ok() ? *exit : ReportError(exit.status());
}

// A descriptor that is closed would be taken by the next file or socket, and what is printed with it.
void HoldStandardDescriptors() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    // Open for reading, so that what is printed there fails and is not lost unnoticed.
    if (::fcntl(fd, F_GETFD) < 0) ::open("/dev/null", fd == STDERR_FILENO ? O_WRONLY : O_RDONLY);
  }
}

// The exit status of a verb that ended with `status`, once its output is written.
int WithOutput(int status) {
  const int error = FlushStandardOutput();
  if (error == 0) return status;
  if (error == EPIPE) {  // as in "myograde show 7 | head": ends as other programs do there
    ::signal(SIGPIPE, SIG_DFL);
    ::raise(SIGPIPE);
  }
  // A verb that failed has said why.
  if (status != kDone) return status;
  return ReportError(absl::InternalError(
      absl::StrCat("standard output can't be written: ", std::strerror(error))));
}

int Main(int argc, char** argv) {
  HoldStandardDescriptors();
  // A daemon that hangs up is an error to report, not the end of this process.
  ::signal(SIGPIPE, SIG_IGN);
  // So that the width of each character is known.
  std::setlocale(LC_CTYPE, "C.UTF-8");
  // What the store logs must not get into what a verb prints.
  spdlog::set_default_logger(spdlog::stderr_logger_mt("myograde"));
  const StandardOutput output;
  try {
    return WithOutput(Run(argc, argv));
  } catch (const std::exception& error) {
    // Out of memory, or an answer of the daemon with values of other types than documented.
    FlushStandardOutput();
    return ReportError(absl::InternalError(error.what()));
  }
}

}  // namespace
}  // namespace myograde::server

#ifdef __SANITIZE_ADDRESS__
// A verb's process ends at once, and tests start thousands: to look for leaks takes a third of each.
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }
#endif

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
