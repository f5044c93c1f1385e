// myograde show
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/report.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ShowOptions : SubmissionOptions {
  bool episodes = false;
  bool full_hashes = false;
};

void PrintShown(const Json& result, const ShowOptions& options) {
  std::cout << Bold(absl::StrCat("Submission ", options.id, " of ", Cell(result, "team"), ": ",
                                 Cell(result, "state")))
            << '\n'
            << "  " << Cell(result, "track") << " in the profile " << Cell(result, "profile")
            << (result.value("phase", Json()).is_string() ? ", phase " + Cell(result, "phase") : "")
            << (result.value("ranked", false) ? "" : " (practice)") << ", "
            << CountsText(result.value("episodes", Json::object())) << '\n';
  if (result.contains("reason") && result["reason"].is_string()) {
    std::cout << "  " << Cell(result, "reason") << '\n';
  }
  PrintResult(result, options.full_hashes);
  if (options.episodes) {
    PrintEpisodes(result.value("episode_rows", Json::array()),
                  result.value("metrics", Json::array()), options.full_hashes);
  }
}

int Show(const ShowOptions& options) {
  const std::string path = options.Resource(options.episodes ? "/result?episodes=1" : "/result");
  return PrintAnswer(options.client().Get(path), options.json,
                     [&](const Json& result) { PrintShown(result, options); });
}

}  // namespace

Action AddShow(CLI::App& verb) {
  auto options = std::make_shared<ShowOptions>();
  AddSubmissionId(verb, *options);
  verb.add_flag("--episodes", options->episodes, "Every episode on a line of its own");
  AddFullHashes(verb, options->full_hashes);
  AddDaemonOptions(verb, "show", *options);
  return [options] { return Show(*options); };
}

}  // namespace myograde::server
