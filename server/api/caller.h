// Who made the request that this thread handles. Only inside handlers.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "server/access/access.h"
#include "server/api/access_log.h"
#include "server/store/store.h"

namespace myograde::server {

const Identity& Caller();
// As the store's rows name it: "uid 1000", "token 7".
std::string CallerKey();
// Organisers and operators; false as long as nobody knows who asks.
bool CallerIsOrganiser();
// Whether the caller's role allows an action besides that of the request's address.
bool CallerMay(Action action);

// Whether the caller may take the request's action for a team, given by today's name
// (Teams::NameOf). If not, the status is `missing`: what the answer would be if there were nothing
// of the kind.
absl::Status Require(const std::string& team, const absl::Status& missing);
// The same for the team of a submission or an evaluation. NotFoundError for those of other teams as
// for those that there are none of. Organisers are always let through, as they are to hear what the
// store knows of a damaged one.
absl::Status RequireSubmission(const Transaction& reader, int64_t id);
absl::Status RequireEvaluation(const Transaction& reader, int64_t id);
// A rejudge's evaluations are the organisers' until it is applied for the first time.
bool CallerSees(const Transaction& reader, int64_t rejudge);

// The same for the team called `name`, now or formerly. NotFoundError for one of others as for one
// that there is not.
absl::Status RequireTeam(const Transaction& reader, const std::string& name);
// Records that the caller may not do what they asked for, for a reason that the handler found.
void NoteDenial(const std::string& why);

// What the row about an organiser's request tells: "submission 7", and what changed. A request
// without is recorded if it is not a GET.
void NoteAct(const std::string& subject, const std::string& detail);

// Makes `identity` the caller of the request that this thread handles, while this object lives.
class CallerScope {
 public:
  // `log` must outlive it.
  CallerScope(const Identity& identity, Action action, AccessLog& log);
  ~CallerScope();
  CallerScope(const CallerScope&) = delete;
  CallerScope& operator=(const CallerScope&) = delete;

  // Records an organiser's act, if the request was one and `http` says that it took effect. `path`
  // stands for the subject where NoteAct told none.
  void Finish(const std::string& method, const std::string& path, int http);
};

}  // namespace myograde::server
