// myograde show, myograde rerun
#include <charconv>
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/follow.h"
#include "server/cli/report.h"
#include "server/cli/terminal.h"
#include "server/cli/verify_rerun.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ShowOptions {
  ApiOptions daemon;
  int64_t id = 0;
  bool episodes = false;
  bool full_hashes = false;
  bool json = false;
};

int Show(const ShowOptions& options) {
  const Client client(options.daemon.path());
  const absl::StatusOr<Json> result =
      client.Get(absl::StrCat("/v1/submissions/", options.id, "/result",
                              options.episodes ? "?episodes=1" : ""));
  if (!result.ok()) return Complain(result.status());
  if (options.json) {
    PrintJson(*result);
    return kDone;
  }
  std::cout << Bold(absl::StrCat("Submission ", options.id, " of ", Cell(*result, "team"), ": ",
                                 Cell(*result, "state")))
            << '\n'
            << "  " << Cell(*result, "track") << " in the profile " << Cell(*result, "profile")
            << (result->value("ranked", false) ? "" : " (practice)") << ", "
            << CountsText(result->value("episodes", Json::object())) << '\n';
  if (result->contains("reason") && (*result)["reason"].is_string()) {
    std::cout << "  " << Cell(*result, "reason") << '\n';
  }
  PrintResult(*result, options.full_hashes);
  if (options.episodes) {
    PrintEpisodes(result->value("episode_rows", Json::array()),
                  result->value("metrics", Json::array()), options.full_hashes);
  }
  return kDone;
}

struct RerunOptions {
  ApiOptions daemon;
  int64_t id = 0;
  std::string episodes;
  bool wait = true;
  bool verify = false;
  bool json = false;
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
    if (!verify.ok()) return Complain(verify.status());
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
    return Complain(absl::InvalidArgumentError("--verify: needs the end; leave --no-wait out"));
  }
  const absl::StatusOr<Json> range = RangeOf(options.episodes);
  if (!range.ok()) return Complain(range.status());
  const Client client(options.daemon.path());
  const absl::StatusOr<Json> rerun =
      client.Post(absl::StrCat("/v1/submissions/", options.id, "/rerun"), *range);
  if (!rerun.ok()) return Complain(rerun.status());
  const int64_t evaluation = rerun->value("evaluation", int64_t{0});
  if (!options.wait) {
    if (options.json) {
      PrintJson(*rerun);
    } else {
      std::cout << "Evaluation " << evaluation << " plays episodes " << Cell(*rerun, "first")
                << " to " << Cell(*rerun, "last") << " of submission " << options.id << " again."
                << std::endl;
    }
    return kDone;
  }
  const absl::StatusOr<Json> result =
      Follow(client, absl::StrCat("/v1/evaluations/", evaluation),
             absl::StrCat("re-run of episodes ", Cell(*rerun, "first"), " to ",
                          Cell(*rerun, "last")));
  if (!result.ok()) return Complain(result.status());
  return ReportRerun(options, client, *result);
}

}  // namespace

Action AddShow(CLI::App& verb) {
  auto options = std::make_shared<ShowOptions>();
  AddSubmissionId(verb, options->id);
  verb.add_flag("--episodes", options->episodes, "Every episode on a line of its own");
  AddFullHashes(verb, options->full_hashes);
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/show.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Show(*options); };
}

Action AddRerun(CLI::App& verb) {
  auto options = std::make_shared<RerunOptions>();
  AddSubmissionId(verb, options->id);
  verb.add_option("--episodes", options->episodes,
                  "A..B, counted from 0, both included; the whole blocks of episodes that hold "
                  "them are played (default: all)");
  verb.add_flag("--wait,!--no-wait", options->wait,
                "Wait for the end and print the differences (default), or only start it");
  verb.add_flag("--verify", options->verify,
                "Tell of each episode whether actions, states and result were the same, and where "
                "not, whether the policy or the simulator is the cause");
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/rerun.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Rerun(*options); };
}

}  // namespace myograde::server
