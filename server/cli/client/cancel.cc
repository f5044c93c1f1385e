// myograde cancel
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/report.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct CancelOptions : SubmissionOptions {
  std::string reason;
};

// What the kill did, in words.
std::string KillText(const Json& kill) {
  const int64_t killed = kill.value("killed", int64_t{0});
  if (killed == 0) return "nothing of it was running";
  const std::string took = absl::StrFormat("%.2f s", kill.value("took_wall_s", 0.0));
  std::string text =
      killed == 1 ? absl::StrCat("its running block of episodes was killed within ", took)
                  : absl::StrCat("its ", killed, " running blocks of episodes were killed within ",
                                 took);
  if (const int64_t left = kill.value("still_ending", int64_t{0}); left > 0) {
    absl::StrAppend(&text, " (", left, " not dead yet; the slot stays taken until then)");
  }
  return text;
}

// What became of the team's quota, in words; "" if the daemon does not tell.
std::string QuotaText(const Json& status) {
  const Json cancel = status.value("cancel", Json::object());
  if (!cancel.contains("charged")) return "";
  if (!cancel["charged"].is_string()) {
    return " Nothing of the team's quota is used up: no episode of it had ended.";
  }
  return absl::StrCat(" It stays charged to the team's quota, as one ",
                      Cell(cancel, "charged") == "practice" ? "practice" : "official",
                      " evaluation: cancelling gives nothing back.");
}

void PrintCancelled(const Json& status, int64_t id) {
  std::cout << "Submission " << id << " is " << Cell(status, "state") << "; "
            << KillText(status.value("cancel", Json::object())) << "; it keeps "
            << CountsText(status.value("episodes", Json::object())) << "."
            << QuotaText(status) << std::endl;
}

int Cancel(const CancelOptions& options) {
  Json body = Json::object();
  if (!options.reason.empty()) body["reason"] = options.reason;
  return PrintAnswer(options.client().Post(options.Resource("/cancel"), body), options.json,
                     [&](const Json& status) { PrintCancelled(status, options.id); });
}

}  // namespace

Action AddCancel(CLI::App& verb) {
  auto options = std::make_shared<CancelOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--reason", options->reason, "Why, for the record; up to 200 bytes");
  AddDaemonOptions(verb, "cancel", *options);
  return [options] { return Cancel(*options); };
}

}  // namespace myograde::server
