// Starters: folders with a policy that plays as it is, for participants to begin with.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>

namespace myograde::server {

// What `myograde new` knows about a policy when it is written.
struct Starter {
  std::string lang;   // "cpp", "python" or "torch"
  std::string name;   // of the policy, as CheckPolicyName() takes it
  std::string track;  // that its README plays
};

// The languages that have a starter, as Starter::lang.
std::vector<std::string> StarterLanguages();

// "" if `name` can stand in sources, file names and policy.json; else what it must be.
std::string CheckPolicyName(const std::string& name);

// Makes the new folder `folder` from the templates that came with this program, and returns the
// names of its files, sorted. The folder appears only when it is complete, and never in the place
// of something else. InvalidArgumentError if something has its name or it can't be written,
// InternalError if the templates are missing.
absl::StatusOr<std::vector<std::string>> WriteStarter(const Starter& starter,
                                                      const std::string& folder);

}  // namespace myograde::server
