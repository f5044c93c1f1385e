// myograde new
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/tracks/registry.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/starter.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/grading/tracks.h"

namespace myograde::server {
namespace {

struct NewOptions {
  HostOptions host;
  Starter starter;
  std::string output;
  bool json = false;
};

// What to type in the folder: the commands of its README.
std::vector<std::string> CommandsOf(const Starter& starter) {
  const std::string submission = starter.lang == "python" ? "." : "submission";
  return {
      starter.lang == "cpp" ? "./build.sh" : absl::StrCat("myograde spec --track ", starter.track),
      absl::StrCat("myograde local ", submission, " --track ", starter.track, " --episodes 1"),
      absl::StrCat("myograde submit ", submission, " --track ", starter.track,
                   " --team \"Team Blue\" --wait")};
}

void PrintMade(const std::string& folder, const std::vector<std::string>& files,
               const std::vector<std::string>& commands) {
  std::cout << Bold(Harmless(folder)) << ": a policy that plays as it is, in "
            << absl::StrCat(files.size()) << " files. Go on with\n\n  cd " << Harmless(folder)
            << '\n';
  for (const std::string& command : commands) std::cout << "  " << Harmless(command) << '\n';
  std::cout << "\nREADME.md there says more." << std::endl;
}

int New(const NewOptions& options) {
  const absl::StatusOr<Tracks> tracks = Tracks::Load(options.host.configs_dir() + "/tracks");
  if (!tracks.ok()) return ReportError(HostStatus("", tracks.status()));
  const Starter& starter = options.starter;
  if (const auto track = tracks->Find(starter.track, ""); !track.ok()) {
    return ReportError(track.status());
  }
  // Without a slash at the end, so that a name beside it can be made.
  std::string folder = options.output.empty() ? starter.name : options.output;
  while (folder.size() > 1 && folder.ends_with('/')) folder.pop_back();
  const absl::StatusOr<std::vector<std::string>> files = WriteStarter(starter, folder);
  if (!files.ok()) return ReportError(files.status());
  const std::vector<std::string> commands = CommandsOf(starter);
  if (options.json) {
    PrintJson({{"folder", std::filesystem::absolute(folder).string()},
               {"name", starter.name},
               {"lang", starter.lang},
               {"track", starter.track},
               {"files", *files},
               {"commands", commands}});
  } else {
    PrintMade(folder, *files, commands);
  }
  return kDone;
}

}  // namespace

Action AddNew(CLI::App& verb) {
  auto options = std::make_shared<NewOptions>();
  verb.add_option("NAME", options->starter.name, "Name of the policy and of its folder")
      ->required()
      ->check(CLI::Validator(CheckPolicyName, ""));
  verb.add_option("--lang", options->starter.lang, "Its language")
      ->required()
      ->check(CLI::IsMember(StarterLanguages()));
  verb.add_option("--track", options->starter.track,
                  "Track that its README plays; the policy plays all of them")
      ->default_val(TrackNames().front());
  verb.add_option("-o,--output", options->output,
                  "The folder to make, which must not exist (default: NAME in the current folder)");
  AddJson(verb, "new", options->json);
  AddHostOptions(verb, options->host);
  return [options] { return New(*options); };
}

}  // namespace myograde::server
