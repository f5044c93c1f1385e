// Identifies the grader's build: what a result depends on besides submission, config and seeds.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace myograde::server {

// The version, and the SHA-256 of the simulator, of MuJoCo's library and of the compiled models in
// `cache_dir`; null for an unreadable file. `adapters`: the names of those whose files are part of it
// too ("" is none), under "adapters", which is absent without them. A file is read again only if it
// has changed.
nlohmann::json GraderBuild(const std::string& cache_dir,
                           const std::vector<std::string>& adapters = {});

// This program's version.
std::string GraderVersion();

}  // namespace myograde::server
