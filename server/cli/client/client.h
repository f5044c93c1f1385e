// The daemon's HTTP API (server/api/README.md), over its Unix socket or the network.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <functional>
#include <string>

#include "server/cli/client/server_choice.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// One connection for each request. Errors: UnavailableError if no daemon
// answers in time, InvalidArgumentError with the daemon's sentence if it
// refuses the request, InternalError if the daemon is in trouble.
class Client {
 public:
  // An error is that of every request.
  explicit Client(absl::StatusOr<ServerChoice> choice);

  // Where requests go, as people write it; "" if there is no such place.
  std::string where() const { return choice_.ok() ? choice_->address.Text() : ""; }

  absl::StatusOr<Json> Get(const std::string& path) const;
  absl::StatusOr<Json> Post(const std::string& path, const Json& body) const;

  // Post for what must be done once: the request has an Idempotency-Key of its own, and is sent once
  // more if its answer is lost.
  absl::StatusOr<Json> PostOnce(const std::string& path, const Json& body) const;

  // Sends `file`, whose content is of `type`; `progress` hears the bytes sent so far, of how many.
  absl::StatusOr<Json> Upload(const std::string& path, const std::string& file,
                              const std::function<void(int64_t done, int64_t total)>& progress,
                              const std::string& type = "application/x-tar") const;

  // Gives the answer's bytes to `sink` piece by piece (false: stop) and says how many they were.
  // Whatever its size, little of it is in memory at a time.
  absl::StatusOr<int64_t> Download(
      const std::string& path, const std::function<bool(const char*, size_t)>& sink,
      const std::function<void(int64_t done, int64_t total)>& progress) const;

 private:
  absl::StatusOr<ServerChoice> choice_;
};

// The code of the error (server/api/README.md) that the daemon answered with; "": it gave none.
std::string AnsweredCode(const absl::Status& status);

// All pages of the list at `path`, which has no query, as one answer; `rows` is the key of its
// rows. Errors of Client::Get.
absl::StatusOr<Json> GetAllPages(const Client& client, const std::string& path,
                                 const std::string& rows);

// The exit status that a final state stands for.
int ExitOfState(const std::string& state);

// The phases of all challenges in an answer of GET /v1/challenges.
Json AllPhases(const Json& answer);

// The one called `name`; null if there is none.
Json PhaseIn(const Json& answer, const std::string& name);

// A phase as GET /v1/challenges has it. InvalidArgumentError: there is none of that name; else an
// error of Client::Get.
absl::StatusOr<Json> FindPhaseOf(const Client& client, const std::string& phase);

// Whether an evaluation or a submission has ended, of which this is the status.
inline bool HasEnded(const Json& status) {
  const std::string state = status.value("state", "");
  return state != "queued" && state != "running";
}

// Asks for `path`, something that is in progress, until an answer is `final`, showing progress
// named `what`; the last answer. A daemon that stays silent for 30 s in a row ends the waiting; one
// that restarts does not.
absl::StatusOr<Json> FollowUntil(const Client& client, const std::string& path,
                                 const std::string& what,
                                 const std::function<bool(const Json&)>& final = HasEnded);

}  // namespace myograde::server
