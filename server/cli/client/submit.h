// myograde submit, except what it does only on this host (../offline/dry_run.cc).
#pragma once

#include <absl/status/statusor.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "server/cli/client/client.h"

namespace myograde::server {

struct SubmitOptions : DaemonOptions {
  std::string path;
  std::string name;   // of the policy; "": the submission's own
  std::string track;  // "": the phase's
  std::string team;
  std::string profile;
  std::string phase;
  std::string seeds;
  int64_t episodes = 0;  // 0: not given
  bool wait = false;
  bool full_hashes = false;
};

// Adds all of them; the flag --wait is returned.
CLI::Option* AddSubmitOptions(CLI::App& verb, SubmitOptions& options);

// Neither a track nor a phase: InvalidArgumentError.
absl::Status CheckPlaceGiven(const SubmitOptions& options);

// Uploads, submits and, if asked to, waits; the exit status.
absl::StatusOr<int> Submit(SubmitOptions options);

// A submission, with what is known of it on this host.
struct SubmissionPlan : SubmitOptions {
  std::string artefact;               // its digest; "": unknown
  std::vector<std::string> runtimes;  // that its policy.json names
  std::string config;                 // hash of this host's config of track and profile

  // On seeds of its own, or on some of the practice seeds.
  bool practice() const { return !seeds.empty() || episodes > 0; }
};

enum class FindingState {
  kOk,
  kWarning,  // it would be accepted, and is worth a look
  kUnknown,  // it could not be checked here
  kFails,
};

// What a check found, in words, so that everything is reported at once and not the first mistake.
struct Finding {
  std::string check;  // one word
  FindingState state = FindingState::kOk;
  std::string found;      // a sentence without a full stop
  std::string todo = {};  // what to do about it; "" if nothing
};

// What the server would answer to a submission, asked before anything is sent: who the caller is
// and whether the team may submit, whether track and phase are open, whether the server's rules are
// those of this host, which runtimes it has, and what is left of the quota. Nothing is changed
// there, except that a denied request is counted like any other. False: the server can't be
// reached, and nothing else is known.
bool AskAcceptance(const Client& client, const SubmissionPlan& plan,
                   std::vector<Finding>& findings);

}  // namespace myograde::server
