// Foreign text on a terminal.
#pragma once

#include <string>
#include <string_view>

namespace myograde::server {

// `text` for a terminal, as one line: what a terminal would obey, and what would turn or hide the words
// around it (plain_text.h), becomes '?', as do line ends and invalid bytes. Tabs stay if `tabs`.
// Whatever a program prints that somebody else chose (names of files, a policy's strings, answers of
// a server) goes through here.
std::string Harmless(std::string_view text, bool tabs = false);

}  // namespace myograde::server
