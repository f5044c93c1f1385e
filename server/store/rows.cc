#include "server/store/rows.h"

#include <absl/strings/str_cat.h>

#include "server/base/enum_names.h"

namespace myograde::server {
namespace {

constexpr std::string_view kLeaseStates[] = {"pending", "running", "done", "failed", "cancelled"};
constexpr std::string_view kEvaluationKinds[] = {"original", "rerun", "rejudge"};
constexpr std::string_view kEvaluationStates[] = {"queued", "running",   "done",
                                                  "failed", "cancelled", "grader_error"};

}  // namespace

std::string_view LeaseStateName(LeaseState state) { return NameIn(kLeaseStates, state); }

std::optional<LeaseState> ParseLeaseState(std::string_view name) {
  return ParseIn<LeaseState>(kLeaseStates, name);
}

std::string_view EvaluationStateName(EvaluationState state) {
  return NameIn(kEvaluationStates, state);
}

std::optional<EvaluationState> ParseEvaluationState(std::string_view name) {
  return ParseIn<EvaluationState>(kEvaluationStates, name);
}

std::string_view EvaluationKindName(EvaluationKind kind) {
  return NameIn(kEvaluationKinds, kind);
}

std::optional<EvaluationKind> ParseEvaluationKind(std::string_view name) {
  return ParseIn<EvaluationKind>(kEvaluationKinds, name);
}

absl::Status UnknownArtefact(const std::string& hash) {
  return absl::NotFoundError(absl::StrCat("there is no artefact ", hash, "; upload it first"));
}

const std::string& ConfigOf(const EvaluationRow& evaluation, const SubmissionRow& submission) {
  return evaluation.config.empty() ? submission.config : evaluation.config;
}

const std::string& SeedsOf(const EvaluationRow& evaluation, const SubmissionRow& submission) {
  return evaluation.seeds.empty() ? submission.seeds : evaluation.seeds;
}

bool IsFinal(LeaseState state) {
  return state != LeaseState::kPending && state != LeaseState::kRunning;
}

bool IsFinal(EvaluationState state) {
  return state != EvaluationState::kQueued && state != EvaluationState::kRunning;
}

}  // namespace myograde::server
