// Text of participants that others see: names of teams and policies, reasons.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace myograde::server {

// A code point that would change how a board or a terminal shows what surrounds
// it: control characters of both kinds, directions of writing, what is not seen.
bool IsHarmful(char32_t c);

// The code point of UTF-8 at `text[at]`, which must be there; `at` goes behind it.
// kBroken, and one byte further: it is none.
inline constexpr char32_t kBroken = 0xffffffff;
char32_t TakeCodePoint(std::string_view text, size_t& at);

// The first harmful code point of valid UTF-8 as U+XXXX; "" if there is none.
std::string FirstHarm(std::string_view text);

bool IsUtf8(std::string_view text);

// 1 to `max` bytes of valid UTF-8 without harmful code points, with no space at
// either end.
bool IsPlainText(std::string_view text, size_t max);

}  // namespace myograde::server
