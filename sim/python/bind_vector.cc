#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/unique_ptr.h>

#include "sim/python/bindings.h"
#include "sim/python/vector_environment.h"

namespace myograde::sim {
namespace {

namespace nb = nanobind;
using nb::literals::operator""_a;  // NOLINT(misc-unused-using-decls): it is, of literals

using Flags = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

std::unique_ptr<VectorEnvironment> MakeVector(int count, int threads, const std::string& tracks_dir,
                                              const std::string& track, const std::string& profile,
                                              const std::string& config_file,
                                              const std::string& cache_dir, bool direct,
                                              bool extra, int64_t max_steps) {
  if (count < 1 || threads < 1) {
    throw nb::value_error("the numbers of environments and of threads must be at least 1");
  }
  const EnvironmentOptions options =
      OptionsFrom(tracks_dir, track, profile, config_file, cache_dir, direct, extra, max_steps);
  absl::StatusOr<std::unique_ptr<VectorEnvironment>> made;
  {
    nb::gil_scoped_release released;
    made = VectorEnvironment::Make(options, count, threads);
  }
  RaiseUnlessOk(made.status());
  return *std::move(made);
}

template <typename Call>
void Alone(VectorEnvironment& self, Call call) {
  absl::Status status;
  {
    nb::gil_scoped_release released;
    const std::lock_guard<std::mutex> lock(self.mutex());
    status = call();
  }
  RaiseUnlessOk(status);
}

void ResetVector(VectorEnvironment& self, uint32_t present,
                 const std::optional<LegSetValues>& leg_sets, const std::optional<Flags>& only) {
  std::span<const uint8_t> mask;
  if (only.has_value()) {
    mask = {only->data(), only->size()};
    if (mask.size() != static_cast<size_t>(self.count())) {
      throw nb::value_error("the mask must have an entry for each environment");
    }
  }
  const nlohmann::json parameters = ParametersFrom(present, leg_sets);
  Alone(self, [&] { return self.Reset(parameters, mask); });
}

nb::list Histories(VectorEnvironment& self) {
  std::vector<absl::StatusOr<std::vector<EpisodeInputs>>> histories;
  Alone(self, [&] {
    for (int i = 0; i < self.count(); ++i) histories.push_back(self.at(i).History());
    return absl::OkStatus();
  });
  nb::list list;
  for (const auto& history : histories) {
    RaiseUnlessOk(history.status());
    list.append(ListFrom(*history));
  }
  return list;
}

void RestoreVector(VectorEnvironment& self, uint32_t present,
                   const std::optional<LegSetValues>& leg_sets, const nb::list& list) {
  if (list.size() != static_cast<size_t>(self.count())) {
    throw nb::value_error("the state is of another number of environments");
  }
  std::vector<std::vector<EpisodeInputs>> histories;
  for (const nb::handle history : list) histories.push_back(HistoryFrom(nb::cast<nb::list>(history)));
  const nlohmann::json parameters = ParametersFrom(present, leg_sets);
  Alone(self, [&] { return self.Restore(parameters, histories); });
}

// What was measured in each episode so far: an array by the keys of a result's JSON.
nb::dict FactsOf(const VectorEnvironment& self) {
  nb::dict dict;
  std::vector<void*> columns;
  for (int i = 0; i < self.count(); ++i) {
    const EpisodeFacts facts = self.at(i).environment().facts();
    size_t column = 0;
    const auto put = [&]<typename Value>(const char* key, const Value& value) {
      if (i == 0) {
        auto* values = new Value[static_cast<size_t>(self.count())]();
        const nb::capsule owner(values, [](void* array) noexcept {
          delete[] static_cast<Value*>(array);
        });
        columns.push_back(values);
        dict[key] = nb::ndarray<nb::numpy, Value>(values, {static_cast<size_t>(self.count())}, owner);
      }
      static_cast<Value*>(columns[column++])[i] = value;
    };
    put("steps", facts.steps);
    put("sim_time", facts.sim_time);
    put("clipped", facts.clipped);
    std::visit([&put](const auto& measured) { measured.Visit(measured, put); }, facts.track);
  }
  return dict;
}

void StepVector(VectorEnvironment& self, const Doubles<2>& actions) {
  if (actions.shape(0) != static_cast<size_t>(self.count()) ||
      actions.shape(1) != static_cast<size_t>(self.at(0).action_size())) {
    throw nb::value_error(absl::StrCat("the actions must be an array of ", self.count(), " x ",
                                       self.at(0).action_size(), ", not ",
                                       actions.shape(0), " x ", actions.shape(1))
                              .c_str());
  }
  Alone(self, [&] { return self.Step({actions.data(), actions.size()}); });
}

// The array itself: it is kept alive by the environments, and each step writes into it.
template <auto values>
auto View(VectorEnvironment& self) {
  auto& vector = (self.*values)();
  using Value = typename std::remove_reference_t<decltype(vector)>::value_type;
  const auto rows = static_cast<size_t>(self.count());
  if (vector.size() == rows) {
    return nb::ndarray<nb::numpy, Value>(vector.data(), {rows}, nb::find(self));
  }
  return nb::ndarray<nb::numpy, Value>(vector.data(), {rows, vector.size() / rows},
                                       nb::find(self));
}

auto Weights(VectorEnvironment& self) {
  return nb::ndarray<nb::numpy, double>(self.weights().data(), {self.weights().size()},
                                        nb::find(self));
}

nb::dict EndOf(const VectorEnvironment& self, int index) {
  if (index < 0 || index >= self.count()) {
    throw nb::index_error("the environment's index is out of range");
  }
  return EndOf(self.at(index));
}

}  // namespace

void BindVectorEnvironment(nb::module_& module) {
  nb::class_<VectorEnvironment>(module, "VectorEnvironment",
                                "Environments that threads step side by side; see myograde.envs.")
      .def(nb::new_(&MakeVector), "count"_a, "threads"_a, "tracks_dir"_a, "track"_a,
           "profile"_a = "", "config_file"_a = "", "cache_dir"_a, "direct"_a = false,
           "extra_observations"_a = false, "max_steps"_a = 0)
      .def("reset", &ResetVector, "leg_sets_present"_a = 0, "leg_sets"_a = nb::none(),
           "only"_a = nb::none(),
           "Begins an episode of seeds[i] in each environment, or in those that `only` marks.")
      .def("step", &StepVector, "actions"_a,
           "Plays a control step in each environment without the GIL, or begins the next episode "
           "where one ended in the last step.")
      .def("histories", &Histories, "Of each environment, as Environment.history().")
      .def("restore", &RestoreVector, "leg_sets_present"_a, "leg_sets"_a.none(), "histories"_a,
           "Plays these instead of its own; the arrays of flags and rewards stay unchanged.")
      .def("facts", nb::overload_cast<const VectorEnvironment&>(&FactsOf),
           "What was measured in each episode so far, an array by name.")
      .def("end_of", nb::overload_cast<const VectorEnvironment&, int>(&EndOf), "index"_a,
           "How the episode of an environment ended, and what was measured in it.")
      .def_prop_ro("count", &VectorEnvironment::count)
      .def_prop_ro("threads", &VectorEnvironment::threads)
      .def_prop_ro("weights", &Weights)
      .def_prop_ro("seeds", &View<&VectorEnvironment::seeds>)
      .def_prop_ro("observations", &View<&VectorEnvironment::observations>)
      .def_prop_ro("terms", &View<&VectorEnvironment::terms>)
      .def_prop_ro("rewards", &View<&VectorEnvironment::rewards>)
      .def_prop_ro("terminated", &View<&VectorEnvironment::terminated>)
      .def_prop_ro("truncated", &View<&VectorEnvironment::truncated>)
      .def_prop_ro("was_reset", &View<&VectorEnvironment::was_reset>)
      .def_prop_ro("first", [](const VectorEnvironment& self) -> const GradedEnvironment& {
        return self.at(0);
      }, nb::rv_policy::reference_internal, "For layouts and reward terms; don't step it.");
}

}  // namespace myograde::sim
