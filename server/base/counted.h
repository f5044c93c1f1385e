// Counts in sentences.
#pragma once

#include <cstdint>
#include <string>

#include <absl/strings/str_cat.h>

namespace myograde::server {

// "1 submission", "2 submissions"; `many` where the plural is no "s" behind `one`.
inline std::string Counted(int64_t count, const char* one, const char* many = nullptr) {
  if (count == 1) return absl::StrCat("1 ", one);
  return many != nullptr ? absl::StrCat(count, " ", many) : absl::StrCat(count, " ", one, "s");
}

// What one process of a policy plays, in participants' words: "2 blocks of episodes".
inline std::string CountedBlocks(int64_t count) {
  return Counted(count, "block of episodes", "blocks of episodes");
}

}  // namespace myograde::server
