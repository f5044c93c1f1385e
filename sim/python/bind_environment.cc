#include <algorithm>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <mujoco/mujoco.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/unique_ptr.h>

#include "sim/python/bindings.h"

namespace myograde::sim {
namespace {

namespace nb = nanobind;
using nb::literals::operator""_a;  // NOLINT(misc-unused-using-decls): it is, of literals

// Without Python's lock, so that other threads run meanwhile, and with the environment's own.
class Exclusively {
 public:
  explicit Exclusively(GradedEnvironment& environment) : lock_(environment.mutex()) {}

 private:
  nb::gil_scoped_release released_;
  std::lock_guard<std::mutex> lock_;
};

std::unique_ptr<GradedEnvironment> Make(const std::string& tracks_dir, const std::string& track,
                                        const std::string& profile,
                                        const std::string& config_file,
                                        const std::string& cache_dir, bool direct, bool extra) {
  const EnvironmentOptions options =
      OptionsFrom(tracks_dir, track, profile, config_file, cache_dir, direct, extra);
  absl::StatusOr<std::unique_ptr<GradedEnvironment>> made;
  {
    nb::gil_scoped_release released;
    made = GradedEnvironment::Make(options);
  }
  RaiseUnlessOk(made.status());
  return *std::move(made);
}

auto Observe(const GradedEnvironment& self) {
  const auto size = static_cast<size_t>(self.observation_size());
  auto values = NewArray(size);
  self.Observe({values.data(), size});
  return values;
}

auto RewardTerms(const GradedEnvironment& self) {
  const size_t size = self.reward_terms().size();
  auto values = NewArray(size);
  self.RewardTerms({values.data(), size});
  return values;
}

auto Reset(GradedEnvironment& self, uint64_t seed, uint32_t present,
           const std::optional<LegSetValues>& leg_sets) {
  const nlohmann::json parameters = ParametersFrom(present, leg_sets);
  absl::Status status;
  {
    const Exclusively alone(self);
    status = self.Reset(seed, parameters);
  }
  RaiseUnlessOk(status);
  return Observe(self);
}

nb::tuple Step(GradedEnvironment& self, const Doubles<1>& action) {
  const std::span<const double> values(action.data(), action.size());
  RaiseUnlessOk(self.CheckAction(values));
  absl::Status status;
  {
    const Exclusively alone(self);
    status = self.Step(values);
  }
  RaiseUnlessOk(status);
  return nb::make_tuple(Observe(self), RewardTerms(self), self.terminated(), self.truncated());
}

nb::list History(GradedEnvironment& self) {
  absl::StatusOr<std::vector<EpisodeInputs>> history;
  {
    const Exclusively alone(self);
    history = self.History();
  }
  RaiseUnlessOk(history.status());
  return ListFrom(*history);
}

void Restore(GradedEnvironment& self, const nb::list& list) {
  const std::vector<EpisodeInputs> history = HistoryFrom(list);
  absl::Status status;
  {
    const Exclusively alone(self);
    status = self.Restore(history);
  }
  RaiseUnlessOk(status);
}

nb::dict ReadPhysics(const GradedEnvironment& self) {
  const mjModel& model = self.environment().model();
  const std::span<const double> state = self.environment().state();
  nb::dict dict;
  size_t place = 0;
  for (const auto& [name, size] : {std::pair("time", 1), std::pair("qpos", model.nq),
                                   std::pair("qvel", model.nv), std::pair("act", model.na)}) {
    const auto count = std::min(static_cast<size_t>(size), state.size() - place);
    auto values = NewArray(count);
    std::ranges::copy(state.subspan(place, count), values.data());
    dict[name] = values;
    place += count;
  }
  return dict;
}

nb::list ReadTerms(const GradedEnvironment& self) {
  nb::list terms;
  for (const RewardTerm& term : self.reward_terms()) {
    terms.append(nb::make_tuple(term.name, term.weight));
  }
  return terms;
}

nb::list ObservationParts(const GradedEnvironment& self) {
  const VectorLayout& graded = ObservationOf(*self.config().kind);
  nb::list parts = PartsOf(graded);
  if (self.extra_observations()) {
    parts.extend(PartsOf(ExtraOf(*self.config().kind), graded.size()));
  }
  return parts;
}

}  // namespace

void BindEnvironment(nb::module_& module) {
  nb::class_<GradedEnvironment>(module, "Environment",
                                "One environment of a track config; see myograde.envs.")
      .def(nb::new_(&Make), "tracks_dir"_a, "track"_a, "profile"_a = "", "config_file"_a = "",
           "cache_dir"_a, "direct"_a = false, "extra_observations"_a = false,
           "Loads config and model. Errors: ValueError, FileNotFoundError, RuntimeError.")
      .def("reset", &Reset, "seed"_a, "leg_sets_present"_a = 0, "leg_sets"_a = nb::none(),
           "Begins the episode of a seed; returns its first observation.")
      .def("step", &Step, "action"_a,
           "Plays a control step without the GIL; returns (observation, reward terms, terminated, "
           "truncated), the arrays new ones.")
      .def("observe", &Observe, "The observation of the current state, as a new array.")
      .def("reward_values", &RewardTerms, "The reward terms of the current state, unweighted.")
      .def("history", &History,
           "All inputs that the current state depends on; restore() takes them.")
      .def("restore", &Restore, "history"_a,
           "Plays the history of an environment with the same arguments, instead of its own.")
      .def("physics", &ReadPhysics, "time, qpos, qvel and act after the last step, as new arrays.")
      .def("facts", [](const GradedEnvironment& self) { return FactsOf(self.facts()); },
           "What was measured in the episode so far, by the keys of a result's JSON.")
      .def("end_of", nb::overload_cast<const GradedEnvironment&>(&EndOf),
           "How the episode ended (end is \"\" while it runs), and what was measured in it.")
      .def_prop_ro("end", &EndNameOf, "How the episode ended, as in a result; \"\" until then.")
      .def_prop_ro("digest", &GradedEnvironment::digest,
                   "SHA-256 over the states of all steps so far, as in a result.")
      .def_prop_ro("actions_digest", &GradedEnvironment::actions_digest,
                   "The same over the actions.")
      .def_prop_ro("seed", &GradedEnvironment::seed)
      .def_prop_ro("steps", &GradedEnvironment::steps)
      .def_prop_ro("observation_size", &GradedEnvironment::observation_size)
      .def_prop_ro("action_size", &GradedEnvironment::action_size)
      .def_prop_ro("kind", [](const GradedEnvironment& self) { return self.config().kind->name; })
      .def_prop_ro("horizon",
                   [](const GradedEnvironment& self) {
                     const absl::StatusOr<int64_t> steps =
                         self.config().kind->max_steps(self.config().rules);
                     RaiseUnlessOk(steps.status());
                     return *steps;
                   },
                   "Control steps of the longest episode.")
      .def_prop_ro("profile",
                   [](const GradedEnvironment& self) { return self.config().profile; })
      .def_prop_ro("control_period_s",
                   [](const GradedEnvironment& self) {
                     return self.config().kind->control_period_s;
                   })
      .def_prop_ro("reward_terms", &ReadTerms, "[(name, default weight)], in their order.")
      .def_prop_ro("observation_parts", &ObservationParts)
      .def_prop_ro("action_parts",
                   [](const GradedEnvironment& self) {
                     return PartsOf(ActionOf(*self.config().kind));
                   })
      .def_prop_ro("action_bounds", [](const GradedEnvironment& self) {
        return ToTuple(self.config().kind->layout().action_bounds(self.convention()));
      });
}

}  // namespace myograde::sim
