// Which build grades: what a result is a function of besides submission, config and seeds.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace myograde::server {

// The version, and the SHA-256 of the simulator, of MuJoCo's library and of the compiled models in
// `cache_dir`; null for a file that can't be read. A file is read again only when it has changed.
nlohmann::json GraderBuild(const std::string& cache_dir);

// The version of this program.
std::string GraderVersion();

}  // namespace myograde::server
