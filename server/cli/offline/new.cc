// myograde new
#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/tracks/registry.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/grading/tracks.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// A folder with a policy that plays as it is, for participants to begin with.
struct Starter {
  std::string lang;   // "cpp", "python" or "torch"
  std::string name;   // of the policy, as CheckPolicyName() takes it
  std::string track;  // that its README plays
};

constexpr size_t kLongestName = 64;  // of policy.json

absl::Status CantMake(const std::string& folder, const std::string& reason) {
  return absl::InvalidArgumentError(
      absl::StrCat(folder, ": can't be made: ", reason, "; choose another place with --output"));
}

absl::Status IsThere(const std::string& folder) {
  return absl::InvalidArgumentError(
      absl::StrCat(folder,
                   ": is there already, and stays as it is; choose another name, or "
                   "another place with --output"));
}

// Where an installation and a build tree have the templates of a language, seen from the programs.
absl::StatusOr<std::string> TemplatesOf(const std::string& lang) {
  ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
  for (const std::string& place : {ShareDir(bin_dir) + "/policies", bin_dir + "/../policies"}) {
    const std::string templates = absl::StrCat(place, "/starter/", lang);
    std::error_code error;
    if (fs::exists(templates + "/README.md", error)) return templates;
  }
  return absl::InternalError(absl::StrCat("the starter for ", lang,
                                          " is not beside the programs in ", bin_dir,
                                          "; install MyoGrade again, or build the target "
                                          "myograde_policies"));
}

// One file of a template. `from` is a file of this installation.
absl::Status WriteFrom(const Starter& starter, const std::string& from, const std::string& to) {
  const absl::StatusOr<std::string> text = ReadFile(from);
  if (!text.ok()) return absl::InternalError(text.status().message());
  RETURN_IF_ERROR(WriteFile(
      to, absl::StrReplaceAll(*text, {{"@NAME@", starter.name}, {"@TRACK@", starter.track}})));
  if (::access(from.c_str(), X_OK) != 0) return absl::OkStatus();
  using fs::perms;
  std::error_code error;
  fs::permissions(to, perms::owner_exec | perms::group_exec | perms::others_exec,
                  fs::perm_options::add, error);
  return error ? CantMake(to, error.message()) : absl::OkStatus();
}

// All files of a template in the new folder `folder`; their names, sorted.
absl::StatusOr<std::vector<std::string>> WriteAllFrom(const Starter& starter,
                                                      const std::string& templates,
                                                      const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  if (!fs::create_directory(folder, error)) return CantMake(folder, error.message());
  fs::recursive_directory_iterator entry(templates, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().lexically_relative(templates).string();
    const std::string to = absl::StrCat(folder, "/", name);
    if (entry->is_directory(error)) {
      fs::create_directory(to, error);
      if (error) return CantMake(to, error.message());
    } else {
      RETURN_IF_ERROR(WriteFrom(starter, entry->path(), to));
      names.push_back(name);
    }
  }
  if (error) return absl::InternalError(absl::StrCat(templates, ": ", error.message()));
  std::sort(names.begin(), names.end());
  return names;
}

// "" if `name` can stand in sources, file names and policy.json; else what it must be.
std::string CheckPolicyName(const std::string& name) {
  if (IsPlainName(name, kLongestName)) return "";
  return absl::StrCat("a policy's name here has 1 to ", kLongestName,
                      " of the characters A-Z, a-z, 0-9, \"-\", \"_\" and \".\", and begins with a "
                      "letter or digit");
}

// Makes the new folder `folder` from the templates that came with this program, and returns the
// names of its files, sorted. The folder appears only when it is complete, and never in the place
// of something else. InvalidArgumentError if something has its name or it can't be written,
// InternalError if the templates are missing.
absl::StatusOr<std::vector<std::string>> WriteStarter(const Starter& starter,
                                                      const std::string& folder) {
  std::error_code error;
  if (fs::symlink_status(folder, error).type() != fs::file_type::not_found) {
    return error ? CantMake(folder, error.message()) : IsThere(folder);
  }
  ASSIGN_OR_RETURN(const std::string templates, TemplatesOf(starter.lang));
  // Made beside its place, and removed with everything in it unless it gets its name.
  std::string part = folder + ".part-XXXXXX";
  if (::mkdtemp(part.data()) == nullptr) return CantMake(folder, std::strerror(errno));
  const std::string made = part + "/made";
  auto names = WriteAllFrom(starter, templates, made);
  // Over an empty folder at worst, if one appeared since.
  if (names.ok() && ::rename(made.c_str(), folder.c_str()) != 0) {
    const bool there = errno == EEXIST || errno == ENOTEMPTY || errno == ENOTDIR;
    names = there ? IsThere(folder) : CantMake(folder, std::strerror(errno));
  }
  std::error_code ignored;  // nobody is left to tell
  fs::remove_all(part, ignored);
  return names;
}

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

void PrintMade(const std::string& folder, const Json& made) {
  std::cout << Bold(Harmless(folder)) << ": a policy that plays as it is, in "
            << made["files"].size() << " files. Go on with\n\n  cd " << Harmless(folder) << '\n';
  for (const Json& command : made["commands"]) {
    std::cout << "  " << Harmless(command.get<std::string>()) << '\n';
  }
  std::cout << "\nREADME.md there says more." << std::endl;
}

absl::StatusOr<int> New(const NewOptions& options) {
  ASSIGN_OR_RETURN(const Tracks tracks,
                   HostStatus("", Tracks::Load(options.host.configs_dir() + "/tracks")));
  const Starter& starter = options.starter;
  RETURN_IF_ERROR(tracks.Find(starter.track, "").status());
  // Without a slash at the end, so that a name beside it can be made.
  std::string folder = options.output.empty() ? starter.name : options.output;
  while (folder.size() > 1 && folder.ends_with('/')) folder.pop_back();
  ASSIGN_OR_RETURN(const std::vector<std::string> files, WriteStarter(starter, folder));
  return PrintAnswer(Json{{"folder", fs::absolute(folder).string()},
                          {"name", starter.name},
                          {"lang", starter.lang},
                          {"track", starter.track},
                          {"files", files},
                          {"commands", CommandsOf(starter)}},
                     options.json, [&](const Json& made) { PrintMade(folder, made); });
}

}  // namespace

Action AddNew(CLI::App& verb) {
  auto options = std::make_shared<NewOptions>();
  verb.add_option("NAME", options->starter.name, "Name of the policy and of its folder")
      ->required()
      ->check(CLI::Validator(CheckPolicyName, ""));
  verb.add_option("--lang", options->starter.lang, "Its language")
      ->required()
      ->check(CLI::IsMember({"cpp", "python", "torch"}));
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
