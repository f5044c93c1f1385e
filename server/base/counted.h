// Counts for use in sentences.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>

namespace myograde::server {

// "1 submission", "2 submissions", "3 entries"; pass `many` for what has another plural than those.
inline std::string Counted(int64_t count, const char* one, const char* many = nullptr) {
  if (count == 1) return absl::StrCat("1 ", one);
  if (many != nullptr) return absl::StrCat(count, " ", many);
  std::string_view word = one;
  const bool in_y = word.size() > 1 && word.back() == 'y' &&
                    std::string_view("aeiou").find(word[word.size() - 2]) == std::string_view::npos;
  if (in_y) word.remove_suffix(1);
  return absl::StrCat(count, " ", std::string(word), in_y ? "ies" : "s");
}

// The episodes of a lease as participants call them: "2 blocks of episodes".
inline std::string CountedBlocks(int64_t count) {
  return Counted(count, "block of episodes", "blocks of episodes");
}

}  // namespace myograde::server
