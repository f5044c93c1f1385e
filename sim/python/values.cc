#include <algorithm>
#include <cstring>
#include <memory>
#include <string>
#include <variant>

#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>

#include "protocol/base/config_reader.h"
#include "protocol/bridge/leg_sets_json.h"
#include "protocol/lease/lease.h"
#include "sim/python/bindings.h"

namespace myograde::sim {

namespace nb = nanobind;

void RaiseUnlessOk(const absl::Status& status) {
  if (status.ok()) return;
  const std::string sentence(status.message());
  if (absl::IsInvalidArgument(status)) throw nb::value_error(sentence.c_str());
  PyErr_SetString(absl::IsNotFound(status) ? PyExc_FileNotFoundError : PyExc_RuntimeError,
                  sentence.c_str());
  throw nb::python_error();
}

EnvironmentOptions OptionsFrom(const std::string& tracks_dir, const std::string& track,
                               const std::string& profile, const std::string& config_file,
                               const std::string& cache_dir, bool direct, bool extra,
                               int64_t max_steps) {
  return {.tracks_dir = tracks_dir,
          .track = track,
          .profile = profile,
          .config_file = config_file,
          .cache_dir = cache_dir,
          .convention = direct ? ActionConvention::kDirect : ActionConvention::kNormalized,
          .extra_observations = extra,
          .max_steps = max_steps};
}

nlohmann::json ParametersFrom(uint32_t present, const std::optional<LegSetValues>& values) {
  LegParameterSets sets = {};
  if (!values.has_value()) return nlohmann::json::object();
  sets.present = present;
  const double* from = values->data();
  for (auto& set : sets.set) {
    for (LegStateParameters& state : set) {
      for (double* to : {&state.knee_stiffness, &state.knee_damping, &state.knee_target,
                         &state.ankle_stiffness, &state.ankle_damping, &state.ankle_target}) {
        *to = *from++;
      }
      for (double& threshold : state.threshold) threshold = *from++;
      for (uint8_t& kind : state.threshold_kind) {
        kind = static_cast<uint8_t>(std::clamp(*from++, 0.0, 255.0));
      }
    }
  }
  return LegSetsToJson(sets);
}

nb::list ListFrom(const std::vector<EpisodeInputs>& history) {
  nb::list list;
  for (const EpisodeInputs& episode : history) {
    const std::string parameters = episode.parameters.dump();
    list.append(nb::make_tuple(
        episode.seed, nb::bytes(parameters.data(), parameters.size()),
        nb::bytes(episode.actions.data(), episode.actions.size() * sizeof(double))));
  }
  return list;
}

std::vector<EpisodeInputs> HistoryFrom(const nb::list& list) {
  std::vector<EpisodeInputs> history;
  for (const nb::handle entry : list) {
    const auto episode = nb::cast<nb::tuple>(entry);
    const auto text = nb::cast<nb::bytes>(episode[1]);
    const auto actions = nb::cast<nb::bytes>(episode[2]);
    EpisodeInputs& inputs = history.emplace_back();
    absl::StatusOr<nlohmann::json> parameters = ParseJson({text.c_str(), text.size()}, "a state");
    if (!parameters.ok() || !parameters->is_object() || actions.size() % sizeof(double) != 0) {
      throw nb::value_error("the state is of another version of myograde");
    }
    inputs.seed = nb::cast<uint64_t>(episode[0]);
    inputs.parameters = *std::move(parameters);
    inputs.actions.resize(actions.size() / sizeof(double));
    if (!inputs.actions.empty()) {
      std::memcpy(inputs.actions.data(), actions.c_str(), actions.size());
    }
  }
  return history;
}

nb::ndarray<nb::numpy, double, nb::ndim<1>> NewArray(size_t size) {
  auto values = std::make_unique<double[]>(size);
  double* data = values.get();
  nb::capsule owner(data, [](void* array) noexcept { delete[] static_cast<double*>(array); });
  values.release();
  return nb::ndarray<nb::numpy, double, nb::ndim<1>>(data, {size}, owner);
}

nb::list PartsOf(const VectorLayout& layout, int offset) {
  nb::list parts;
  for (const Part& part : layout.parts()) {
    nb::list entries;
    for (int i = part.offset; i < part.offset + part.size; ++i) {
      const std::string_view full = layout.names()[static_cast<size_t>(i)];
      entries.append(full);
    }
    nb::dict described;
    described["name"] = part.name;
    described["offset"] = part.offset + offset;
    described["size"] = part.size;
    described["unit"] = part.unit;
    described["meaning"] = part.meaning;
    described["entries"] = nb::tuple(entries);
    parts.append(described);
  }
  return parts;
}

nb::tuple ToTuple(std::span<const Bounds> bounds) {
  nb::list low, high;
  for (const Bounds& bound : bounds) {
    low.append(bound.low);
    high.append(bound.high);
  }
  return nb::make_tuple(low, high);
}

nb::dict FactsOf(const EpisodeFacts& facts) {
  nb::dict dict;
  dict["steps"] = facts.steps;
  dict["sim_time"] = facts.sim_time;
  dict["clipped"] = facts.clipped;
  std::visit(
      [&dict](const auto& measured) {
        measured.Visit(measured,
                       [&dict](const char* key, const auto& value) { dict[key] = value; });
      },
      facts.track);
  return dict;
}

namespace {

// What JSON details are made of: objects, lists, numbers and null.
nb::object ValueFrom(const nlohmann::json& json) {
  if (json.is_object()) {
    nb::dict dict;
    for (const auto& [key, value] : json.items()) dict[key.c_str()] = ValueFrom(value);
    return dict;
  }
  if (json.is_array()) {
    nb::list list;
    for (const nlohmann::json& value : json) list.append(ValueFrom(value));
    return list;
  }
  return json.is_number() ? nb::object(nb::float_(json.get<double>())) : nb::object(nb::none());
}

}  // namespace

std::string_view EndNameOf(const GradedEnvironment& environment) {
  if (environment.unstable()) return OutcomeName(Outcome::kUnstable);
  if (!environment.terminated() && !environment.truncated()) return "";
  // Also where the caller's own limit of steps cut an episode that the track would have gone on with.
  const EpisodeEnd time = EpisodeEnd::kTime;
  return environment.truncated() ? time.name() : environment.facts().end.name();
}

nb::dict EndOf(const GradedEnvironment& environment) {
  nb::dict dict;
  dict["end"] = EndNameOf(environment);
  dict["facts"] = FactsOf(environment.facts());
  const EpisodeDetails details = environment.environment().details();
  dict["details"] = details ? ValueFrom(DetailsToJson(*details)) : nb::object(nb::none());
  dict["digest"] = environment.digest();
  dict["actions_digest"] = environment.actions_digest();
  dict["seed"] = environment.seed();
  dict["steps"] = environment.steps();
  return dict;
}

}  // namespace myograde::sim
