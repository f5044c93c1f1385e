// What this host offers to submissions by name: folders with packages for policies. README.md
// describes the folders and their file runtime.json.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// Describes a runtime; lies at the top of its folder.
inline constexpr char kRuntimeFile[] = "runtime.json";

struct RuntimePackage {
  std::string name;
  std::string version;
  std::string source;  // "pypi" or "debian"
};

struct Runtime {
  std::string name = {};
  std::string folder = {};    // on this host; mounted at the same path in the sandbox
  // SHA-256 (hex) of its listing, which identifies its content; "": not known, as it has no
  // runtime.json. Then what follows is "" and 0, too.
  std::string digest = {};
  std::string python = {};    // the version that it was made for: "3.11"
  std::string made_at = {};   // RFC 3339
  int64_t bytes = 0;
  int64_t files = 0;
  std::vector<RuntimePackage> packages = {};
  bool configured = false;    // named by server.json, rather than found in the runtimes' folder
};

// Whether a runtime may be called that: 1 to 64 of a-z, 0-9, ".", "_" and "-", the first of them a
// letter or digit.
bool IsRuntimeName(std::string_view name);

// Reads the runtime.json of a folder. NotFoundError: it has none. InvalidArgumentError: it is not as
// README.md says.
absl::StatusOr<Runtime> ReadRuntime(const std::string& folder);

// The runtimes of a server. The runtimes' folder is looked at anew each time, so what is added or
// removed counts at once. Safe from any thread.
class Runtimes {
 public:
  // `configured`: folders by name (`runtimes` of server.json), which hide those in `dir` of the same
  // name. `dir`: the runtimes' folder (`runtimes_dir`); "": there is none.
  Runtimes(std::map<std::string, std::string> configured, std::string dir)
      : configured_(std::move(configured)), dir_(std::move(dir)) {}

  // Sorted by name. What can't be read is left out.
  std::vector<Runtime> List() const;

  // The one of that name. NotFoundError: there is none; InternalError: its folder is gone or can't
  // be read.
  absl::StatusOr<Runtime> Find(const std::string& name) const;

  // The one of that name and digest: the present one, or a former one that was replaced meanwhile.
  // Its folder keeps that content as long as it exists, so a lease may mount it later.
  // NotFoundError: neither; the message says which digest is there.
  absl::StatusOr<Runtime> Find(const std::string& name, const std::string& digest) const;

  // Former versions of runtimes, sorted by folder.
  std::vector<Runtime> Former() const;

 private:
  // All versions below the runtimes' folder, present and former, by folder.
  std::map<std::string, Runtime> Versions() const;

  const std::map<std::string, std::string> configured_;
  const std::string dir_;
};

// Whether a runtime still has the content that it was made with: everything in its folder but its
// runtime.json; links are not followed. One without a digest has. A GB takes a few seconds.
// DataLossError: it has another; InternalError: it can't be read.
absl::Status CheckRuntime(const Runtime& runtime);

// {name: digest} of the runtimes that there are, without those of unknown digest; of `names` only.
nlohmann::json RuntimeDigests(const Runtimes& runtimes, const std::vector<std::string>& names);
nlohmann::json RuntimeDigests(const Runtimes& runtimes);

// A grader's build (GraderBuild) together with runtimes, of RuntimeDigests: what a result depends on
// besides submission, config and seeds. Without runtimes it stays as it is.
nlohmann::json WithRuntimes(nlohmann::json grader, nlohmann::json digests);

// As GET /v1/runtimes has it; where it lies is nothing for strangers.
nlohmann::json RuntimeToJson(const Runtime& runtime);

}  // namespace myograde::server
