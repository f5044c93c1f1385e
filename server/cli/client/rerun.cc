// myograde rerun
#include <charconv>
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/follow.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/client/verify_rerun.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct RerunOptions : SubmissionOptions {
  std::string episodes;
  bool wait = true;
  bool verify = false;
};

// "A..B", both counted from 0 and included, or "A" for one.
absl::StatusOr<Json> RangeOf(const std::string& text) {
  if (text.empty()) return Json::object();
  const absl::Status bad = absl::InvalidArgumentError(
      absl::StrCat("--episodes: \"", Harmless(text),
                   "\" is no range; write A..B with 0 <= A <= B, both included, as 10..19"));
  const size_t dots = text.find("..");
  const std::string first_text = text.substr(0, dots);
  const std::string last_text = dots == std::string::npos ? first_text : text.substr(dots + 2);
  int64_t first = -1;
  int64_t last = -1;
  for (const auto& [part, value] : {std::pair{&first_text, &first}, {&last_text, &last}}) {
    const char* end = part->data() + part->size();
    const auto [stop, error] = std::from_chars(part->data(), end, *value);
    if (error != std::errc() || stop != end) return bad;
  }
  if (first < 0 || last < first) return bad;
  return Json{{"first", first}, {"last", last}};
}

int ReportRerun(const RerunOptions& options, const Client& client, Json result) {
  const std::string state = result.value("state", "");
  const Json comparison = result.value("comparison", Json());
  if (options.verify && comparison.is_object()) {
    absl::StatusOr<Json> verify = VerifyRerun(client, result);
    if (!verify.ok()) return ReportError(verify.status());
    result["verify"] = *std::move(verify);
  }
  if (options.json) {
    PrintJson(result);
  } else {
    std::cout << Bold(absl::StrCat("Re-run ", Cell(result, "evaluation"), " of submission ",
                                   options.id, " is ", Harmless(state)))
              << '\n';
    PrintComparison(comparison);
    if (result.contains("verify")) PrintVerify(result["verify"]);
  }
  if (state == "grader_error") return kTrouble;
  if (state == "cancelled" || !comparison.is_object()) return kNoScore;
  const bool same = comparison.value("equal", int64_t{0}) ==
                        comparison.value("compared", int64_t{-1}) &&
                    comparison.value("missing", int64_t{0}) == 0;
  return same ? kDone : kNoScore;
}

int Rerun(const RerunOptions& options) {
  if (options.verify && !options.wait) {
    return ReportError(absl::InvalidArgumentError("--verify: needs the end; leave --no-wait out"));
  }
  const absl::StatusOr<Json> range = RangeOf(options.episodes);
  if (!range.ok()) return ReportError(range.status());
  const Client client = options.client();
  const absl::StatusOr<Json> rerun = client.PostOnce(options.Resource("/rerun"), *range);
  if (!rerun.ok()) return ReportError(rerun.status());
  const int64_t evaluation = rerun->value("evaluation", int64_t{0});
  if (!options.wait) {
    return PrintAnswer(rerun, options.json, [&](const Json& started) {
      std::cout << "Evaluation " << evaluation << " plays episodes " << Cell(started, "first")
                << " to " << Cell(started, "last") << " of submission " << options.id << " again."
                << std::endl;
    });
  }
  const absl::StatusOr<Json> result =
      Follow(client, absl::StrCat("/v1/evaluations/", evaluation),
             absl::StrCat("re-run of episodes ", Cell(*rerun, "first"), " to ",
                          Cell(*rerun, "last")));
  if (!result.ok()) return ReportError(result.status());
  return ReportRerun(options, client, *result);
}

}  // namespace

Action AddRerun(CLI::App& verb) {
  auto options = std::make_shared<RerunOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--episodes", options->episodes,
                  "A..B, counted from 0, both included; the whole blocks of episodes that hold "
                  "them are played (default: all)");
  verb.add_flag("--wait,!--no-wait", options->wait,
                "Wait for the end and print the differences (default), or only start it");
  verb.add_flag("--verify", options->verify,
                "Report for each episode whether actions, states and result were the same, and "
                "where not, whether the policy or the simulator is the cause");
  AddDaemonOptions(verb, "rerun", *options);
  return [options] { return Rerun(*options); };
}

}  // namespace myograde::server
