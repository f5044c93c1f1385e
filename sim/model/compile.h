// Makes a model from the package's source files: checks them, patches their
// text, lets MuJoCo compile it and patches the result.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "sim/model/model.h"
#include "sim/model/source.h"

namespace myograde::sim {

// Compiles a model from sources, each of which is checked against its
// pinned SHA-256: NotFoundError or DataLossError name the first bad file. The
// package itself is not touched: patched files and links to the others go to a
// temporary folder that is gone afterwards, so MuJoCo reads nothing but pinned
// files.
absl::StatusOr<ModelPtr> CompileFromSources(const ModelSource& source,
                                            const std::string& package_dir);

// SHA-256 over everything that a compiled model is a function of: the pinned
// sources, the patches, MuJoCo's version and build.
std::string ModelKey(const ModelSource& source);

}  // namespace myograde::sim
