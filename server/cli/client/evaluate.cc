// myograde evaluate: further episodes for places that are close
#include <iostream>
#include <memory>
#include <string>
#include <utility>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/follow.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct EvaluateOptions : DaemonOptions {
  std::string phase;
  std::string board = "main";
  int64_t more_seeds = 0;
  std::string places;  // "A..B", or "" for all that are undecided
  std::string reason = "close places";
  bool wait = false;
};

absl::StatusOr<Json> PlacesOf(const std::string& text) {
  const std::pair<std::string, std::string> ends = absl::StrSplit(text, absl::MaxSplits("..", 1));
  int64_t first = 0;
  int64_t last = 0;
  if (!absl::SimpleAtoi(ends.first, &first) || !absl::SimpleAtoi(ends.second, &last) ||
      first < 1 || last <= first) {
    return absl::InvalidArgumentError(
        absl::StrCat("--places: \"", Harmless(text), "\" is not two ranks as in 2..4"));
  }
  return Json{first, last};
}

void PrintFurther(const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const Json submissions = rejudge.value("submissions", Json::array());
    std::cout << "Rejudge " << Cell(rejudge, "rejudge") << " plays "
              << CountCell(rejudge, "episodes", "further episode") << " of "
              << Counted(std::ssize(submissions), "submission") << ":";
    for (const Json& submission : submissions) std::cout << ' ' << submission;
    std::cout << "\n";
    const Json lost = rejudge.value("without_files", Json::array());
    if (!lost.empty()) {
      std::cout << "  The files of " << Counted(std::ssize(lost), "submission")
                << " are not on this host any more, so it gets none.\n";
    }
  }
  std::cout << "No rank by the rules changes. Once they have ended, \"myograde leaderboard --phase "
            << Cell(answer, "phase") << " --statistics\" takes them in." << std::endl;
}

// Until all of them have been played, or were dropped.
absl::Status AwaitFurther(const Client& client, const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const std::string id = Cell(rejudge, "rejudge");
    RETURN_IF_ERROR(FollowUntil(
        client, "/v1/rejudges/" + id, "rejudge " + id, [](const Json& now) {
          return now.value("complete", false) || now.value("state", "") == "dropped";
        }).status());
  }
  return absl::OkStatus();
}

int Evaluate(const EvaluateOptions& options) {
  Json body = {{"episodes", options.more_seeds},
               {"board", options.board},
               {"reason", options.reason}};
  if (!options.places.empty()) {
    absl::StatusOr<Json> places = PlacesOf(options.places);
    if (!places.ok()) return ReportError(places.status());
    body["places"] = *std::move(places);
  }
  const Client client = options.client();
  const absl::StatusOr<Json> asked = client.Post(
      absl::StrCat("/v1/phases/", QueryValue(options.phase), "/more-seeds"), body);
  if (asked.ok() && options.wait) {
    const absl::Status played = AwaitFurther(client, *asked);
    if (!played.ok()) return ReportError(played);
  }
  return PrintAnswer(asked, options.json, PrintFurther);
}

}  // namespace

Action AddEvaluate(CLI::App& verb) {
  auto options = std::make_shared<EvaluateOptions>();
  verb.add_option("--phase", options->phase, "The phase whose places are close")->required();
  verb.add_option("--more-seeds", options->more_seeds,
                  "Further episodes of each submission in total, on seeds that follow the "
                  "phase's own")
      ->required()
      ->type_name("N");
  verb.add_option("--places", options->places,
                  "First and last rank (default: all that share a group)")
      ->type_name("A..B");
  verb.add_option("--board", options->board, "Name of the board (default: main)");
  verb.add_option("--reason", options->reason,
                  "Why, for the record; up to 200 bytes (default: \"close places\")");
  verb.add_flag("--wait", options->wait, "Wait until they have been played");
  AddDaemonOptions(verb, "evaluate", *options);
  return [options] { return Evaluate(*options); };
}

}  // namespace myograde::server
