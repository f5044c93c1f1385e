#include <fcntl.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/pinned_maths.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_seed.h"
#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"
#include "sim/episode/replay_player.h"
#include "sim/model/model.h"
#include "sim/python/bindings.h"

namespace myograde::sim {
namespace {

namespace nb = nanobind;
using nb::literals::operator""_a;  // NOLINT(misc-unused-using-decls): it is, of literals

// Looks at the variables that the process was started with: what was set later came too late for
// the C library, which reads the variable at the start, and ends each setting in it with a NUL.
bool MathsArePinned() {
  const absl::StatusOr<std::string> environ = ReadFile("/proc/self/environ");
  if (!environ.ok()) return false;
  const std::string name = absl::StrCat(kTunablesVariable, "=");
  bool inside = false;
  for (absl::string_view variable : absl::StrSplit(*environ, '\0')) {
    const bool first = absl::ConsumePrefix(&variable, name);
    inside = first || (inside && absl::StartsWith(variable, "glibc."));
    if (inside && IsPinned({variable.data(), variable.size()})) return true;
  }
  return false;
}

void CompileAll(const std::string& cache_dir) {
  absl::Status status;
  {
    nb::gil_scoped_release released;
    status = CompileModels(cache_dir);
  }
  RaiseUnlessOk(status);
}

bool AreCompiled(const std::string& cache_dir) {
  for (const SimulatedTrack& track : SimulatedTracks()) {
    if (!IsCompiled(*track.model, cache_dir)) return false;
  }
  return true;
}

nb::dict DescribeConfig(const std::string& tracks_dir, const std::string& track,
                        const std::string& profile, const std::string& config_file) {
  const absl::StatusOr<TrackConfig> config =
      ConfigOf(OptionsFrom(tracks_dir, track, profile, config_file, "", false, false));
  RaiseUnlessOk(config.status());
  nb::list policy_seeds;
  for (size_t i = 0; i < config->seeds.size(); ++i) {
    policy_seeds.append(PolicySeed(config->policy_seed_secret, static_cast<int64_t>(i)));
  }
  const absl::StatusOr<int64_t> max_steps = config->kind->max_steps(config->rules);
  RaiseUnlessOk(max_steps.status());
  nb::dict described;
  described["id"] = config->id;
  described["profile"] = config->profile;
  described["seeds"] = config->seeds;
  described["practice_seeds"] = config->practice_seeds;
  described["policy_seeds"] = policy_seeds;
  described["max_steps"] = *max_steps;
  described["extra_observations"] = config->extra_observations;
  described["hash"] = config->hash;
  return described;
}

absl::StatusOr<ReplayRecord> ReplayLogFile(const std::string& path, const std::string& cache_dir) {
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", strerror(errno)));
  }
  ASSIGN_OR_RETURN(std::string bytes, ReadPackedLog(file.get()));
  ASSIGN_OR_RETURN(const EpisodeLog log, ParseEpisodeLog(bytes));
  ASSIGN_OR_RETURN(auto environment, MakeEnvironment(log.header.track, cache_dir));
  return ReplayLog(log, *environment, [](int64_t) {});
}

nb::dict Replay(const std::string& path, const std::string& cache_dir) {
  absl::StatusOr<ReplayRecord> record;
  {
    nb::gil_scoped_release released;
    record = ReplayLogFile(path, cache_dir);
  }
  RaiseUnlessOk(record.status());
  nb::dict result;
  result["episode"] = record->episode;
  result["equal"] = record->equal;
  result["steps"] = record->steps;
  result["step"] = record->step;
  result["differs"] = record->differs;
  result["detail"] = record->detail;
  return result;
}

}  // namespace

void BindHost(nb::module_& module) {
  module.attr("PINNED_VARIABLE") = kTunablesVariable;
  module.attr("PINNED_VALUE") = kPinnedTunables;
  module.def("maths_are_pinned", &MathsArePinned,
             "Whether this process was started with the maths functions that every grader uses.");
  module.def("compile_models", &CompileAll, "cache_dir"_a,
             "Compiles the models of all tracks into the cache. The maths must be pinned, as "
             "graders may share the cache.");
  module.def("models_are_compiled", &AreCompiled, "cache_dir"_a);
  module.def("describe_config", &DescribeConfig, "tracks_dir"_a, "track"_a, "profile"_a = "",
             "config_file"_a = "");
  module.def("replay", &Replay, "path"_a, "cache_dir"_a,
             "Plays the episode of a log again and compares observations and states.");
}

}  // namespace myograde::sim
