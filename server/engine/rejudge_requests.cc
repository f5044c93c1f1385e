#include "server/engine/rejudge_requests.h"

#include <algorithm>
#include <map>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/json_value.h"
#include "server/engine/stored.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kScoring[] = "scoring";

bool HaveSameFacts(const std::string& from_json, const std::string& to_json) {
  return SameFacts(ParsedText(from_json), ParsedText(to_json));
}

// Of those listed, the ones that have a result; an error names one that has none.
absl::Status CheckListed(const NewRejudge& rejudge, const std::vector<NewEvaluation>& candidates) {
  std::set<int64_t> found;
  for (const NewEvaluation& candidate : candidates) found.insert(candidate.submission);
  for (const int64_t submission : rejudge.submissions) {
    if (found.contains(submission)) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("submission ", submission, " can't get further episodes: it is not ranked, has "
                     "no result under config ", rejudge.from_config.substr(0, 12),
                     ", or is on another board"));
  }
  return absl::OkStatus();
}

}  // namespace

bool SameFacts(const Json& from, const Json& to) {
  if (!from.is_object() || !to.is_object()) return false;
  Json a = from;
  Json b = to;
  a.erase(kScoring);
  b.erase(kScoring);
  return a == b;
}

bool SameSimulation(const Json& a, const Json& b) {
  for (const char* key : {"simulator", "mujoco"}) {
    if (!At(a, key).is_string() || At(a, key) != At(b, key)) return false;
  }
  const Json& adapters_a = At(a, "adapters");
  const Json& adapters_b = At(b, "adapters");
  for (const auto& [name, hash] : adapters_a.items()) {
    if (At(adapters_b, name) != hash) return false;
  }
  // A model is compiled when it is first needed, so one of the builds may know fewer.
  const Json& models_a = At(a, "models");
  const Json& models_b = At(b, "models");
  if (!models_a.is_object() || !models_b.is_object()) return false;
  return std::all_of(models_a.items().begin(), models_a.items().end(), [&](const auto& model) {
    const auto other = models_b.find(model.key());
    return other == models_b.end() || *other == model.value();
  });
}

absl::Status CheckNewRejudge(const NewRejudge& rejudge) {
  const bool rules = rejudge.purpose == RejudgePurpose::kRules;
  const bool facts = rejudge.method == RejudgeMethod::kFacts;
  if (rejudge.why.empty()) return absl::InvalidArgumentError("a rejudge needs a reason");
  if (rejudge.repeats < 1 || rejudge.repeats > kMostRepeats) {
    return absl::InvalidArgumentError(absl::StrCat("a rejudge has 1 to ", kMostRepeats,
                                                   " repeats, not ", rejudge.repeats));
  }
  if (rules != rejudge.submissions.empty()) {
    return absl::InvalidArgumentError(
        rules ? "a change of rules covers all submissions of the board; don't list some"
              : "list at least one submission for further episodes");
  }
  if (facts && (rejudge.repeats > 1 || !rules)) {
    return absl::InvalidArgumentError(
        "repeats and further episodes have to be played; stored facts are not enough");
  }
  if (facts && !HaveSameFacts(rejudge.from_config_json, rejudge.to_config_json)) {
    return absl::InvalidArgumentError(
        "stored facts are not enough: the configs differ in more than \"scoring\"; leave the "
        "method at \"auto\", or choose \"play\"");
  }
  for (const auto& [hash, json] : {std::pair(&rejudge.from_config, &rejudge.from_config_json),
                                   std::pair(&rejudge.to_config, &rejudge.to_config_json),
                                   std::pair(&rejudge.seeds, &rejudge.seeds_json)}) {
    if (Sha256Hex(*json) == *hash) continue;
    return absl::InvalidArgumentError(absl::StrCat(*hash, " is not the hash of its content"));
  }
  return absl::OkStatus();
}

RejudgeMethod ChooseMethod(RejudgeMethod asked, int64_t repeats, bool same_facts,
                           const Json& source_grader, const Json& today) {
  if (asked != RejudgeMethod::kAuto) return asked;
  const bool facts = repeats == 1 && same_facts && SameSimulation(source_grader, today);
  return facts ? RejudgeMethod::kFacts : RejudgeMethod::kPlay;
}

absl::StatusOr<RejudgePlan> PlanRejudge(const Transaction& reader, const NewRejudge& rejudge,
                                        const std::string& data_dir) {
  const std::vector<NewEvaluation> candidates = reader.rejudges.CandidatesFor(rejudge);
  RETURN_IF_ERROR(CheckListed(rejudge, candidates));
  const bool same_facts = rejudge.purpose == RejudgePurpose::kRules &&
                          HaveSameFacts(rejudge.from_config_json, rejudge.to_config_json);
  const Json today = ParsedText(rejudge.grader_json);
  std::map<std::string, RejudgeMethod> methods;  // by the source's build
  std::set<int64_t> submissions;
  std::set<int64_t> without_files;
  RejudgePlan plan;
  for (const NewEvaluation& candidate : candidates) {
    submissions.insert(candidate.submission);
    const absl::StatusOr<EvaluationRow> source = reader.evaluations.Find(candidate.source);
    if (ExtractDamage(source.status()).has_value()) continue;  // it will be without a result
    if (!source.ok()) return source.status();
    const auto [method, is_new] = methods.try_emplace(source->grader_json);
    if (is_new) {
      method->second = ChooseMethod(rejudge.method, rejudge.repeats, same_facts,
                                    ParsedText(source->grader_json), today);
    }
    if (method->second == RejudgeMethod::kFacts) {
      ++plan.facts;
      continue;
    }
    ++plan.play;
    if (candidate.repetition != 1) continue;
    const absl::StatusOr<std::string> why = WhyNotPlayed(reader, candidate.submission, data_dir);
    if (ExtractDamage(why.status()).has_value()) continue;
    if (!why.ok()) return why.status();
    if (!why->empty()) without_files.insert(candidate.submission);
  }
  plan.submissions = std::ssize(submissions);
  plan.without_files.assign(without_files.begin(), without_files.end());
  return plan;
}

absl::StatusOr<std::string> WhyNotPlayed(const Transaction& reader, int64_t submission,
                                         const std::string& data_dir) {
  ASSIGN_OR_RETURN(const SubmissionRow row, reader.submissions.Find(submission));
  if (HasArtefactFiles(data_dir, row.artefact).ok()) return "";
  return absl::StrCat("it can't be played again: the files of artefact ", row.artefact,
                      " are no longer on this host");
}

}  // namespace myograde::server
