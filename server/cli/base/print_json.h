// What --json prints.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace myograde::server {

// `json` as indented text. Invalid UTF-8 becomes U+FFFD; characters that would do something to a
// terminal or hide (plain_text.h) are escaped, so the value is the same.
std::string ShownJson(const nlohmann::json& json);

// Prints ShownJson on standard output, and a newline.
void PrintJson(const nlohmann::json& json);

}  // namespace myograde::server
