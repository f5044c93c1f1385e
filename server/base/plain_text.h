// Participants' text that others see: names of teams and policies, reasons, and foreign text on a
// terminal.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace myograde::server {

// A code point that would change how a board or a terminal shows the text around it: control
// characters (C0, C1), bidirectional controls, invisible characters.
bool IsUnsafe(char32_t c);

// Decodes the UTF-8 code point at `text[at]`, which must exist, and advances `at` past it. If it is
// invalid: returns kBroken and advances by one byte.
inline constexpr char32_t kBroken = 0xffffffff;
char32_t TakeCodePoint(std::string_view text, size_t& at);

// The first harmful code point of valid UTF-8 as U+XXXX; "" if there is none.
std::string FirstUnsafe(std::string_view text);

bool IsUtf8(std::string_view text);

// `bytes` as valid UTF-8 without control characters other than newline and tab: anything else
// becomes U+FFFD, so that it can't break JSON or a terminal.
std::string PrintableUtf8(std::string_view bytes);

// 1 to `max` bytes of valid UTF-8 without harmful code points, and no space at either end.
bool IsPlainText(std::string_view text, size_t max);

// `text` for a terminal, as one line: what a terminal would obey, and what would turn or hide the
// words around it, becomes '?', as do line ends and invalid bytes. Tabs stay if `tabs`. Whatever a
// program prints that somebody else chose (names of files, a policy's strings, answers of a server)
// goes through here.
std::string Sanitized(std::string_view text, bool tabs = false);

// The end of valid UTF-8, as much of it as fits into `most` bytes.
std::string_view LastOf(std::string_view text, size_t most);

}  // namespace myograde::server
