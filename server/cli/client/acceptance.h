// What a server would answer to a submission, asked before anything is sent.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "server/cli/base/finding.h"
#include "server/cli/client/client.h"

namespace myograde::server {

struct SubmissionPlan {
  std::string team;
  std::string track;
  std::string profile;        // "": the default one
  std::string phase;          // "": the only open one of the track
  bool practice = false;      // on seeds of its own, or on some of the practice seeds
  std::string artefact;       // its digest; "": unknown
  std::vector<std::string> runtimes;  // that its policy.json names
  std::string config;         // hash of this host's config of track and profile; "": unknown
};

struct Acceptance {
  bool answered = false;  // false: the server can't be reached, and nothing else is known
  std::vector<Finding> findings;
};

// Asks who the caller is and whether the team may submit, whether track and phase are open, whether
// the server's rules are those of this host, which runtimes it has, and what is left of the quota. Nothing is changed there,
// except that a denied request is counted like any other.
Acceptance AskAcceptance(const Client& client, const SubmissionPlan& plan);

// Their names, sorted. Errors as Client::Get.
absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client);

// A sentence on the first of `named` that is not offered; "" if all are.
std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered);

}  // namespace myograde::server
