// What a mistyped word was meant to be.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

// The candidate that is nearest to `word` by inserted, left out, changed and swapped letters,
// one for three letters at most, or of which `word` is the beginning; "" if none or more
// than one is.
std::string NearestOf(std::string_view word, const std::vector<std::string>& candidates);

}  // namespace myograde::server
