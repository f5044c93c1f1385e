#include "server/api/caller.h"

#include <absl/strings/strip.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxActBytes = 400;

struct CurrentCaller {
  const Identity* identity = nullptr;
  Action action = Action::kReadHealth;
  AccessLog* log = nullptr;
  bool noted = false;
  std::string subject;
  std::string detail;
};
thread_local CurrentCaller caller;

std::string Short(const std::string& text) {
  return IsPlainText(text, kMaxActBytes) ? text : "";
}

}  // namespace

const Identity& Caller() { return *caller.identity; }

std::string CallerKey() { return Caller().key; }

bool CallerIsOrganiser() {
  return caller.identity != nullptr && caller.identity->role >= Role::kOrganiser;
}

bool CallerMay(Action action) { return MayTake(Caller(), action, std::nullopt); }

absl::Status Require(const std::string& team, const absl::Status& missing) {
  if (MayTake(Caller(), caller.action, team)) return absl::OkStatus();
  caller.log->Deny(Caller(), caller.action, "another team's");
  return missing;
}

absl::Status RequireSubmission(const Transaction& reader, int64_t id) {
  if (CallerIsOrganiser()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const std::string team, reader.submissions.TeamOf(id));
  return Require(team, absl::NotFoundError(absl::StrCat("there is no submission ", id)));
}

absl::Status RequireEvaluation(const Transaction& reader, int64_t id) {
  if (CallerIsOrganiser()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const std::string team, reader.evaluations.TeamOf(id));
  const absl::Status missing = absl::NotFoundError(absl::StrCat("there is no evaluation ", id));
  RETURN_IF_ERROR(Require(team, missing));
  const absl::StatusOr<EvaluationRow> evaluation = reader.evaluations.Find(id);
  const int64_t rejudge = evaluation.ok() ? evaluation->rejudge : 0;
  return CallerSees(reader, rejudge) ? absl::OkStatus() : missing;
}

bool CallerSees(const Transaction& reader, int64_t rejudge) {
  return reader.Board().IsShown(rejudge) || CallerIsOrganiser();
}

absl::Status RequireTeam(const Transaction& reader, const std::string& name) {
  return Require(reader.teams.NameOf(name),
                 absl::NotFoundError(absl::StrCat(
                     "there is no team \"", name, "\" that you belong to")));
}

void NoteDenial(const std::string& why) { caller.log->Deny(Caller(), caller.action, why); }

void NoteAct(const std::string& subject, const std::string& detail) {
  caller.noted = true;
  caller.subject = subject;
  caller.detail = detail;
}

CallerScope::CallerScope(const Identity& identity, Action action, AccessLog& log) {
  caller = {&identity, action, &log, false, "", ""};
}

CallerScope::~CallerScope() { caller = {}; }

void CallerScope::Finish(const std::string& method, const std::string& path, int http) {
  constexpr int kDeadline = 504;  // whether it took effect is unknown
  const bool reads = method == "GET" || method == "HEAD";
  // A participant's cancel ends work of the host as an organiser's does.
  const bool act = CallerIsOrganiser() || caller.action == Action::kCancel;
  if (!act || (reads && !caller.noted) || (http >= 400 && http != kDeadline)) return;
  const std::string subject =
      caller.noted ? caller.subject : std::string(absl::StripPrefix(path, "/v1/"));
  const std::string detail =
      http == kDeadline ? "whether it took effect is unknown" : caller.detail;
  caller.log->Act(Caller(), caller.action, Short(subject), Short(detail));
}

}  // namespace myograde::server
