// What is wrong with a command line.
#pragma once

#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace myograde::server {

// One sentence on `mistake`, which parsing `words` gave, with the verb or option that was
// probably meant or the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& mistake,
                       const std::vector<std::string>& words);

}  // namespace myograde::server
