// The challenge's models as MuJoCo 2.2.2 needs them: the files of the
// registry's MyoSuite package, patched at load so that this MuJoCo follows the
// official 3.1.2 (see sim/README.md), compiled once and cached.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/model/source.h"

namespace myograde::sim {

struct ModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPtr = std::unique_ptr<mjModel, ModelDeleter>;
using DataPtr = std::unique_ptr<mjData, DataDeleter>;

// The state of a simulation. ResourceExhaustedError: there is no memory for it.
absl::StatusOr<DataPtr> MakeData(const mjModel& model);

// Loads a model from `cache_dir` (which holds the unpacked
// package under myosuite-2.8.4/ and compiled models under models/). A compiled
// model is used if its name's hash of pinned sources, patches and MuJoCo
// version fits; else it is compiled and, where the folder can be written, kept.
// Sources are read and checked when they are compiled, not again at each load.
// Installs the muscle gain callback (once per process).
// Errors: NotFoundError names the missing file and `./dev setup`;
// DataLossError names an altered source file (every one has a pinned SHA-256)
// or a damaged compiled model (it carries its own).
absl::StatusOr<ModelPtr> LoadModel(const ModelSource& source, const std::string& cache_dir);

// True if LoadModel would find a compiled model.
bool IsCompiled(const ModelSource& source, const std::string& cache_dir);

// Compiles it anew and stores it (`myograde-sim --compile-models`).
absl::Status CompileModel(const ModelSource& source, const std::string& cache_dir);

}  // namespace myograde::sim
