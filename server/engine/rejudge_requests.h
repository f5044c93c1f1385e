// What is checked before a rejudge is created, and what it will do. The requests themselves are
// Engine's (CreateRejudge, EndRejudge); what was created is carried out by Rejudger
// (rejudges.h).
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/store/reader_pool.h"
#include "server/store/rejudges.h"

namespace myograde::server {

// How the submissions that a new rejudge finds will get their results.
struct RejudgePlan {
  int64_t submissions = 0;
  int64_t facts = 0;  // items
  int64_t play = 0;
  // Submissions that have to be played and whose files are no longer on this host, sorted: they
  // will be without a result.
  std::vector<int64_t> without_files;
};

struct CreatedRejudge {
  RejudgeRow rejudge;
  RejudgePlan plan;
};

// Whether two effective configs give the same facts: they differ in "scoring" at most.
bool SameFacts(const nlohmann::json& from, const nlohmann::json& to);

// Whether a build `b` has the simulator, library, compiled models and adapters of `a` (GraderBuild).
bool SameSimulation(const nlohmann::json& a, const nlohmann::json& b);

// InvalidArgumentError, in one sentence: `repeats` out of range, submissions listed for a purpose
// that takes none, facts asked for where more than scoring differs or where repetitions are, ...
absl::Status CheckNewRejudge(const NewRejudge& rejudge);

// How an item of it is made whose source was played by `source_grader`; `today` is this host's build.
// kFacts or kPlay.
RejudgeMethod ChooseMethod(RejudgeMethod asked, int64_t repeats, bool same_facts,
                           const nlohmann::json& source_grader, const nlohmann::json& today);

// What it would do now. The artefacts' files are those in `data_dir`. InvalidArgumentError: a listed
// submission has no result that further episodes could be added to.
absl::StatusOr<RejudgePlan> PlanRejudge(const Transaction& reader, const NewRejudge& rejudge,
                                        const std::string& data_dir);

// Why a submission can't be played, as the files of its artefact are not in `data_dir`; "": it can.
absl::StatusOr<std::string> WhyNotPlayed(const Transaction& reader, int64_t submission,
                                         const std::string& data_dir);

}  // namespace myograde::server
