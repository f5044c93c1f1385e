// What is wrong with a command line.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

// The candidate that is nearest to `word` by inserted, left out, changed and swapped letters,
// one for three letters at most, or of which `word` is the beginning; "" if none or more
// than one is.
std::string NearestOf(std::string_view word, const std::vector<std::string>& candidates);

// One sentence on `mistake`, which parsing `words` gave, with the verb or option that was
// probably meant or the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& mistake,
                       const std::vector<std::string>& words);

}  // namespace myograde::server
