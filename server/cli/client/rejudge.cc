// myograde rejudge: create, list, show, apply, drop
#include <cstdint>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/follow.h"
#include "server/cli/client/pages.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/rejudge_text.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kRejudges[] = "/v1/rejudges";
// No config is near that; the daemon takes bodies of the same size.
constexpr size_t kMaxConfigBytes = 1u << 20;

struct RejudgeOptions : DaemonOptions {
  int64_t id = 0;
  std::string phase;
  std::string track;
  std::string profile;
  std::string config;  // file
  std::string method = "auto";
  int64_t repeat = 1;
  std::string reason;
  std::vector<int64_t> without;
  bool wait = false;

  std::string Resource(const std::string& part = "") const {
    return absl::StrCat(kRejudges, "/", id, part);
  }
};

bool IsComputed(const Json& rejudge) { return rejudge.value("state", "") != "computing"; }

// With every rank's change, or those that can be told so far.
absl::StatusOr<Json> WholeRejudge(const RejudgeOptions& options) {
  return options.client().Get(options.Resource("?changes=1"));
}

int ShowRejudge(const RejudgeOptions& options) {
  if (options.wait) {
    const absl::StatusOr<Json> computed =
        FollowUntil(options.client(), options.Resource(), absl::StrCat("rejudge ", options.id),
                    IsComputed);
    if (!computed.ok()) return ReportError(computed.status());
  }
  const absl::StatusOr<Json> rejudge = WholeRejudge(options);
  const int exit = PrintAnswer(rejudge, options.json, PrintRejudge);
  if (!options.wait || exit != kDone) return exit;
  return rejudge->value("without_result", Json::array()).empty() ? kDone : kNoScore;
}

absl::StatusOr<Json> NewRejudge(const RejudgeOptions& options) {
  if (options.phase.empty() == options.track.empty()) {
    return absl::InvalidArgumentError(
        "name the board to rejudge: --phase, or --track for a track's own");
  }
  if (!options.phase.empty() && !options.profile.empty()) {
    return absl::InvalidArgumentError("--profile: a phase has one; leave it out");
  }
  Json body = {{"reason", options.reason},
               {"method", options.method},
               {"repeats", options.repeat}};
  for (const auto& [key, value] : {std::pair{"phase", &options.phase},
                                   std::pair{"track", &options.track},
                                   std::pair{"profile", &options.profile}}) {
    if (!value->empty()) body[key] = *value;
  }
  if (options.config.empty()) return body;
  absl::StatusOr<Json> config = ReadJsonFile(options.config, kMaxConfigBytes);
  if (!config.ok()) return config.status();
  if (!config->is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(
        options.config, ": is no track config, which is an object in braces; see configs/README.md"));
  }
  body["config"] = *std::move(config);
  return body;
}

int CreateRejudge(RejudgeOptions options) {
  const absl::StatusOr<Json> body = NewRejudge(options);
  if (!body.ok()) return ReportError(body.status());
  const absl::StatusOr<Json> created = options.client().Post(kRejudges, *body);
  if (!created.ok() || !options.wait) return PrintAnswer(created, options.json, PrintRejudge);
  options.id = created->value("rejudge", int64_t{0});
  return ShowRejudge(options);
}

int ApplyRejudge(const RejudgeOptions& options) {
  Json body = {{"reason", options.reason}};
  if (!options.without.empty()) body["without"] = options.without;
  return PrintAnswer(options.client().Post(options.Resource("/apply"), body), options.json,
                     [](const Json& rejudge) {
                       std::cout << "The board of " << RejudgedBoard(rejudge)
                                 << " now has the results of rejudge " << Cell(rejudge, "rejudge")
                                 << ", and its config is "
                                 << HashText(rejudge.value("to_config", ""), false) << "."
                                 << std::endl;
                     });
}

int DropRejudge(const RejudgeOptions& options) {
  return PrintAnswer(options.client().Post(options.Resource("/drop"), {{"reason", options.reason}}),
                     options.json, PrintRejudge);
}

int ListRejudges(const RejudgeOptions& options) {
  return PrintAnswer(GetAllPages(options.client(), kRejudges, "rejudges"), options.json,
                     PrintRejudges);
}

// The parts of the verb, which share their options.
class RejudgeParts {
 public:
  explicit RejudgeParts(CLI::App& verb) : verb_(verb) { verb_.require_subcommand(1); }

  CLI::App* Add(const char* name, const char* does, const char* example, const char* schema,
                std::function<int(const RejudgeOptions&)> action) {
    CLI::App* part = verb_.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde rejudge ", example));
    part->callback([chosen = chosen_, options = options_, action = std::move(action)] {
      *chosen = [options, action] { return action(*options); };
    });
    AddDaemonOptions(*part, schema, *options_);
    return part;
  }
  // The same about one rejudge.
  CLI::App* AddOfOne(const char* name, const char* does, const char* example,
                     std::function<int(const RejudgeOptions&)> action) {
    CLI::App* part = Add(name, does, example, "rejudge", std::move(action));
    part->add_option("ID", options_->id, "The rejudge, as \"myograde rejudge list\" numbers it")
        ->required()
        ->check(CLI::PositiveNumber);
    return part;
  }
  void AddReason(CLI::App* part) {
    part->add_option("--reason", options_->reason, "Why, for the record; up to 200 bytes")
        ->required();
  }
  RejudgeOptions& options() { return *options_; }
  Action Chosen() const {
    return [chosen = chosen_] { return (*chosen)(); };
  }

 private:
  CLI::App& verb_;
  std::shared_ptr<RejudgeOptions> options_ = std::make_shared<RejudgeOptions>();
  std::shared_ptr<Action> chosen_ = std::make_shared<Action>();
};

void AddCreatePart(RejudgeParts& parts) {
  RejudgeOptions& options = parts.options();
  CLI::App* create = parts.Add(
      "create", "Compute a board's results under another config, beside the live board",
      "create --phase final --config new_rules.json --reason \"The line is 80.\" --wait", "rejudge",
      CreateRejudge);
  create->add_option("--phase", options.phase, "The phase whose board is rejudged");
  create->add_option("--track", options.track, "The track whose own board is rejudged");
  create->add_option("--profile", options.profile, "Rules profile (default: the track's own)");
  create
      ->add_option("--config", options.config,
                   "A track config, like those of configs/tracks (default: the same config, for "
                   "another build of the grader or for --repeat)")
      ->type_name("FILE");
  create->add_option("--method", options.method,
                     "facts: compute the results from what was recorded; play: play all again; "
                     "auto: facts where they are enough (default)")
      ->check(CLI::IsMember({"auto", "facts", "play"}));
  create->add_option("--repeat", options.repeat,
                     "Play each this many times and tell which policies are not repeatable, 1 to "
                     "20 (default: 1)")
      ->check(CLI::Range(1, 20));
  create->add_flag("--wait", options.wait, "Wait until it is computed, and show every rank's change");
  parts.AddReason(create);
}

}  // namespace

Action AddRejudge(CLI::App& verb) {
  RejudgeParts parts(verb);
  AddCreatePart(parts);
  parts.Add("list", "List all rejudges, newest first", "list", "rejudges", ListRejudges);
  parts.AddOfOne("show", "Show a rejudge with every rank's change", "show 3", ShowRejudge)
      ->add_flag("--wait", parts.options().wait, "Wait until it is computed");
  CLI::App* apply = parts.AddOfOne(
      "apply", "Make a rejudge's config and results those of the live board",
      "apply 3 --reason \"As announced on 3 May.\"", ApplyRejudge);
  apply->add_option("--without", parts.options().without,
                    "The submissions that have no result, all of them, as in 7,9: they are off the "
                    "board")
      ->delimiter(',')
      ->type_name("IDS");
  parts.AddReason(apply);
  parts.AddReason(parts.AddOfOne(
      "drop", "Give up a rejudge; of an applied one, restore the board that it replaced",
      "drop 3 --reason \"The jury decided otherwise.\"", DropRejudge));
  return parts.Chosen();
}

}  // namespace myograde::server
