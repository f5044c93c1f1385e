// What fills the cache folder on this host, for messages about files that are missing there.
#pragma once

#include <string>

namespace myograde {

// "run ./dev setup", or "run myograde-setup as root" where the programs were installed by a package that
// has it: there is no checkout then.
std::string SetUpAdvice();

// Whether `program` (a path) is an installed one: that of a build lies beside the build's own files.
bool IsInstalled(const std::string& program);

}  // namespace myograde
