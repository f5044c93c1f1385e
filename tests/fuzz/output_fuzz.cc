// A policy's output, on its way into a record and from there onto terminals.
#include <nlohmann/json.hpp>

#include "server/base/child_process.h"
#include "server/base/plain_text.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde::server;
using myograde::fuzz::Require;

namespace {

// REQUIRES nothing of `text`; dump() throws on invalid UTF-8.
void CheckHarmless(const std::string& text) {
  (void)nlohmann::json(text).dump();
  for (const char c : text) {
    const bool control = static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
    Require(!control || c == '\n' || c == '\t', "nothing obeys a terminal");
  }
}

}  // namespace

// The first byte is the size of the pieces in which the rest arrives.
MYOGRADE_FUZZ_TARGET(output)(const uint8_t* data, size_t size) {
  myograde::fuzz::Input input(data, size);
  const size_t piece = input.Byte() + size_t{1};
  const std::string all = input.RestText();
  constexpr int64_t kLimit = 100;
  OutputTail tail(kLimit);
  for (size_t at = 0; at < all.size(); at += piece) {
    tail.Append(std::string_view(all).substr(at, piece));
  }
  Require(tail.total() == static_cast<int64_t>(all.size()), "all output is counted");
  Require(tail.truncated() == (tail.total() > kLimit), "truncation is told");
  const std::string kept = tail.tail();
  Require(kept.size() <= OutputTail::kTailBytes, "a tail is short");
  CheckHarmless(kept);
  OutputTail whole(kLimit);
  whole.Append(all);
  Require(whole.tail() == kept, "the pieces do not matter");
  CheckHarmless(PrintableUtf8(all));
  return 0;
}
