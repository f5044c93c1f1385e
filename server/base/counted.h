// Counts for use in sentences.
#pragma once

#include <cstdint>
#include <string>

#include <absl/strings/str_cat.h>

namespace myograde::server {

// "1 submission", "2 submissions"; pass `many` if the plural is not `one` with an "s".
inline std::string Counted(int64_t count, const char* one, const char* many = nullptr) {
  if (count == 1) return absl::StrCat("1 ", one);
  return many != nullptr ? absl::StrCat(count, " ", many) : absl::StrCat(count, " ", one, "s");
}

// The episodes of a lease as participants call them: "2 blocks of episodes".
inline std::string CountedBlocks(int64_t count) {
  return Counted(count, "block of episodes", "blocks of episodes");
}

}  // namespace myograde::server
