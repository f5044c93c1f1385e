// Time of the public record's tree: one JSON object on standard output.
//
//   record_bench [ENTRIES]    (1,000,000)
//
// Heads, proofs that an entry is there and that an earlier record is the beginning, and their
// verification, each timed by itself for many sizes; and the memory that the tree takes.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "server/proof/merkle_tree.h"

namespace myograde::server {
namespace {

constexpr int kRounds = 2000;

double SecondsOf(const std::function<void()>& call) {
  const auto start = std::chrono::steady_clock::now();
  call();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Median and worst of many calls, in microseconds. `call` gets a number that differs in each.
nlohmann::json Timed(const std::function<bool(int64_t number)>& call) {
  std::vector<double> seconds;
  for (int64_t round = 0; round < kRounds; ++round) {
    bool good = false;
    seconds.push_back(SecondsOf([&] { good = call(round * 7919); }));
    if (good) continue;
    std::fprintf(stderr, "error: a proof does not hold\n");
    std::exit(2);
  }
  std::sort(seconds.begin(), seconds.end());
  return {{"median_us", seconds[seconds.size() / 2] * 1e6}, {"worst_us", seconds.back() * 1e6}};
}

nlohmann::json Measure(int64_t entries) {
  MerkleTree tree;
  const double build = SecondsOf([&] {
    for (int64_t i = 0; i < entries; ++i) {
      tree.Append(absl::StrCat(R"({"at":"2026-11-22T19:20:38.000Z","evaluation":)", i,
                               R"(,"kind":"graded","results":")", std::string(64, 'a'), R"("})"));
    }
  });
  const Sha256Digest root = tree.Root(entries);
  return {{"entries", entries},
          {"build_s", build},
          {"bytes_per_entry", 64},
          {"head", Timed([&](int64_t number) {
             return tree.Root(entries - number % entries) != Sha256Digest{};
           })},
          {"inclusion_proof", Timed([&](int64_t number) {
             const int64_t leaf = number % entries;
             return ProvesInclusion(tree.Leaf(leaf), leaf, entries,
                                    tree.InclusionProof(leaf, entries), root);
           })},
          {"consistency_proof", Timed([&](int64_t number) {
             const int64_t from = 1 + number % entries;
             return ProvesConsistency(from, tree.Root(from), entries, root,
                                      tree.ConsistencyProof(from, entries));
           })}};
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) {
  int64_t entries = 1'000'000;
  if (argc > 2 || (argc == 2 && (!absl::SimpleAtoi(argv[1], &entries) || entries < 1))) {
    std::fprintf(stderr, "use: record_bench [ENTRIES]\n");
    return 2;
  }
  std::printf("%s\n", myograde::server::Measure(entries).dump(2).c_str());
  return 0;
}
