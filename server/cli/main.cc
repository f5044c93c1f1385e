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

#include "protocol/tracks/registry.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

struct Verb {
  const char* name;
  const char* does;
  const char* example;  // what stands behind the verb; TRACK stands for the name of a track
  Action (*add)(CLI::App& verb);
};

constexpr Verb kVerbs[] = {
    {"serve", "Run the daemon in the foreground; SIGTERM stops it without losing anything",
     "--data /srv/myograde", AddServe},
    {"submit", "Hand in a policy to be graded",
     "./my_policy --track TRACK --team \"Team Blue\" --wait", AddSubmit},
    {"status", "Show the daemon and its submissions, or the progress of one", "7", AddStatus},
    {"cancel", "Cancel a queued or running submission", "7", AddCancel},
    {"choose", "Choose the submission that your team stands with, where teams choose", "7",
     AddChoose},
    {"leaderboard", "Show the ranking of the submissions", "--track TRACK", AddLeaderboard},
    {"show", "Show the result of a submission", "7 --episodes", AddShow},
    {"rerun", "Play a submission's episodes again and print what differs",
     "7 --episodes 10..19 --verify", AddRerun},
    {"evaluate", "Play further episodes for places that a phase's own episodes do not decide",
     "--phase final --more-seeds 100", AddEvaluate},
    {"rejudge", "Compute a board under other rules, see what changes, and apply or drop it",
     "create --track TRACK --config new_rules.json --reason \"The line is 80.\"", AddRejudge},
    {"quota", "Show how much a team may still submit, and its ledger",
     "--team \"Team Blue\" --track TRACK", AddQuota},
    {"team", "Manage teams: their names, members, merges and bans", "create \"Team Blue\"",
     AddTeam},
    {"token", "Make, list and revoke the tokens that people use over the network",
     "create --team \"Team Blue\" --label \"Ada's laptop\"", AddToken},
    {"hide", "Take a submission off the boards", "7 --reason \"wrong file\"", AddHide},
    {"unhide", "Put a hidden submission back on the boards", "7", AddUnhide},
    {"disqualify", "List a submission apart, without a rank and with the reason",
     "7 --reason \"reads the seeds\"", AddDisqualify},
    {"baseline", "Show a submission on the boards without a rank, for comparison", "7",
     AddBaseline},
    {"challenge", "Check challenge files, and show what is open", "check ./cup.json", AddChallenge},
    {"phase", "Pause and resume submissions, and publish a frozen board",
     "pause final --reason \"a slot is broken\"", AddPhase},
    {"export", "Write the teams, results and boards of the store as JSON or CSV", "challenge.json",
     AddExport},
    {"import", "Load an export into an empty data folder", "challenge.json --data /srv/copy",
     AddImport},
    {"backup", "Copy the store while the daemon runs", "/srv/backup/store.db", AddBackup},
    {"events", "List the requests that were denied, and what organisers did", "--kind denied",
     AddEvents},
    {"webhook", "List the webhooks of server.json and their deliveries, and test one", "test chat",
     AddWebhook},
    {"cluster", "List the nodes that leases run on, drain one and admit it again",
     "drain node17 --reason \"a fan is broken\"", AddCluster},
    {"log", "Write the log of an episode to a file that LCM's tools can read",
     "7 --episode 3 -o episode3.lcmlog", AddLog},
    {"replay", "Simulate episodes again from their logs, without the policy, and compare",
     "7 --episode 3", AddReplay},
    {"render",
     "Draw an episode from its log: a film, a picture, or a strip of the best and the worst",
     "7 --episode 3 -o episode3.mp4", AddRender},
    {"plot", "Draw figures of a board or of submissions, as SVG or PDF",
     "survival 7 9 -o survival.svg", AddPlot},
    {"report", "Write a report of a submission, or of a phase's results, as one HTML file",
     "7 -o report.html", AddReport},
    {"receipt", "Write the signed receipt of a submission that has ended", "7 -o receipt.json",
     AddReceipt},
    {"verify", "Check a receipt against the organiser's key, without a daemon",
     "receipt.json --key organiser.pem --resimulate 3 --logs ./logs", AddVerify},
    {"record", "Read, prove and export the public record of what happened to results",
     "export ./record", AddRecord},
    {"key", "Print the public key that receipts are checked against", "-o organiser.pem", AddKey},
    {"seeds", "Commit to a phase's seeds, reveal them afterwards, and check them",
     "commit --phase final --secret final.secret", AddSeeds},
    {"release", "Sign the files of a release, and check those of one that you downloaded",
     "verify ./myograde-1.0.0 --key release.pem", AddRelease},
    {"login",
     "Log in to a server over the network; asks for the token, or reads it from standard input",
     "https://grader.example.org:8443", AddLogin},
    {"logout", "Remove the login", "", AddLogout},
    {"whoami", "Show your name, role and team on the server", "", AddWhoami},
    {"new", "Start a policy: write a folder with one that plays as it is",
     "my_policy --lang python --track TRACK", AddNew},
    {"local", "Grade a policy on this host, without a daemon",
     "./my_policy --track TRACK --episodes 5", AddLocal},
    {"try", "Grade a policy on this host for some episodes, and write a report and films of them",
     "./my_policy --track TRACK -o ./try1", AddTry},
    {"runtime", "Make, list and remove the runtimes that policies may ask for", "add torch-cpu",
     AddRuntime},
    {"spec", "Print a track's observations, actions, budgets, rules and scoring",
     "--track TRACK --json", AddSpec},
    {"doctor", "Check what this host has for grading, what it lacks and what that costs", "",
     AddDoctor},
};

constexpr char kStatuses[] =
    "Exit status: 0 done, 1 ended without a score or a difference was found, 2 wrong use,\n"
    "3 the daemon can't be reached, 4 the grader or its host is in trouble.";

int Run(int argc, char** argv) {
  CLI::App app("MyoGrade grades policies of the MyoChallenge 2024 tracks and ranks them.",
               "myograde");
  app.set_version_flag("--version", MYOGRADE_VERSION);
  app.footer(std::string("\"myograde VERB --help\" describes each, with an example.\n") +
             kStatuses);
  app.require_subcommand(1);
  Action chosen;
  for (const Verb& verb : kVerbs) {
    CLI::App* sub = app.add_subcommand(verb.name, verb.does);
    const std::string example =
        absl::StrReplaceAll(verb.example, {{"TRACK", TrackNames().front()}});
    sub->footer(absl::StrCat("Example:\n  myograde ", verb.name, example.empty() ? "" : " ",
                             example, "\n\n", kStatuses));
    sub->callback([&chosen, action = verb.add(*sub)] { chosen = action; });
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    return app.exit(asked);
  } catch (const CLI::ParseError& mistake) {
    const std::vector<std::string> words = {argv + 1, argv + argc};
    return ReportError(absl::InvalidArgumentError(UsageError(app, mistake, words)));
  }
  const absl::StatusOr<int> exit = chosen();
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
