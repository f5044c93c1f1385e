// What --json prints.
#pragma once

#include <nlohmann/json.hpp>

namespace myograde::server {

// Prints one JSON value on standard output, indented, and a newline. Invalid UTF-8 becomes U+FFFD.
void PrintJson(const nlohmann::json& json);

}  // namespace myograde::server
