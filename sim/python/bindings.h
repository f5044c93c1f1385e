// The parts of the extension module myograde._env, and what they share. Each part has a file of its
// own; module.cc joins them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "protocol/policy/layout.h"
#include "protocol/bridge/leg_sets_json.h"
#include "protocol/tracks/episode_facts.h"
#include "sim/python/graded_environment.h"

namespace myograde::sim {

void BindEnvironment(nanobind::module_& module);        // class Environment
void BindRender(nanobind::module_& module);             // class Renderer
void BindVectorEnvironment(nanobind::module_& module);  // class VectorEnvironment
void BindHost(nanobind::module_& module);               // what belongs to no environment

// An array of doubles as callers may pass it: in C order, on the CPU; others are converted.
template <int dimensions>
using Doubles = nanobind::ndarray<const double, nanobind::ndim<dimensions>, nanobind::c_contig,
                                  nanobind::device::cpu>;
using LegSetValues = nanobind::ndarray<const double, nanobind::shape<kLegSets, kLegStates, 16>,
                                       nanobind::c_contig, nanobind::device::cpu>;

// Throws what Python raises: ValueError (InvalidArgument), FileNotFoundError (NotFound), else
// RuntimeError, with the status's sentence.
void RaiseUnlessOk(const absl::Status& status);

EnvironmentOptions OptionsFrom(const std::string& tracks_dir, const std::string& track,
                               const std::string& profile, const std::string& config_file,
                               const std::string& cache_dir, bool direct, bool extra,
                               int64_t max_steps = 0);

// Bit i of `present`: set i is taken from `values`: for each state knee stiffness, damping, target,
// the same of the ankle, then value and kind (0 unused, 1 above, 2 below) of each threshold.
nlohmann::json ParametersFrom(uint32_t present, const std::optional<LegSetValues>& values);

// A history as Python keeps it: [(seed, leg parameter sets, actions)], the latter two as bytes.
nanobind::list ListFrom(const std::vector<EpisodeInputs>& history);
std::vector<EpisodeInputs> HistoryFrom(const nanobind::list& list);

// A new array that Python owns.
nanobind::ndarray<nanobind::numpy, double, nanobind::ndim<1>> NewArray(size_t size);

// A list of dictionaries with the keys of myograde.policy's Part.
nanobind::list PartsOf(const VectorLayout& layout, int offset = 0);
// The bounds of each entry, as two lists.
nanobind::tuple ToTuple(std::span<const Bounds> bounds);
// What was measured, by the keys of the result's JSON.
nanobind::dict FactsOf(const EpisodeFacts& facts);
// "end", "facts", "digest", "actions_digest", "seed" and "steps" of an episode.
nanobind::dict EndOf(const GradedEnvironment& environment);
// How it ended, as in a result; "" while it runs.
std::string_view EndNameOf(const GradedEnvironment& environment);

}  // namespace myograde::sim
