// Identifies the grader's build: what a result depends on besides submission, config and seeds.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

namespace myograde::server {

// The version, and the SHA-256 of the simulator, of MuJoCo's library and of the compiled models in
// `cache_dir`; null for an unreadable file. `adapters`: the names of those whose files are part of it
// too ("" is none), under "adapters", which is absent without them. A file is read again only if it
// has changed.
nlohmann::json GraderBuild(const std::string& cache_dir,
                           const std::vector<std::string>& adapters = {});

// Whether a build `b` has the simulator, library, compiled models and adapters of `a`.
bool SameSimulation(const nlohmann::json& a, const nlohmann::json& b);

// The first 12 digits of the SHA-256 over what a build simulates with, as canonical JSON: the
// simulator, MuJoCo's library and the models. "": the text is no build.
std::string SimulatingBuild(std::string_view grader_json);

// This program's version.
std::string GraderVersion();

}  // namespace myograde::server
