#include "server/cli/base/did_you_mean.h"

#include <algorithm>
#include <cstddef>

namespace myograde::server {
namespace {

constexpr size_t kLongestWord = 64;

// Insertions, omissions, changes and swaps of neighbours that lead from one to the other.
size_t Distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<size_t>> steps(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) {
    for (size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        steps[i][j] = i + j;
        continue;
      }
      const size_t change = a[i - 1] == b[j - 1] ? 0 : 1;
      steps[i][j] = std::min({steps[i - 1][j] + 1, steps[i][j - 1] + 1,
                              steps[i - 1][j - 1] + change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        steps[i][j] = std::min(steps[i][j], steps[i - 2][j - 2] + 1);
      }
    }
  }
  return steps[a.size()][b.size()];
}

// The only one of `candidates` for which `fits`; "" if there is none, or another.
template <typename Fits>
std::string OnlyOne(const std::vector<std::string>& candidates, const Fits& fits) {
  std::string found;
  for (const std::string& candidate : candidates) {
    if (!fits(candidate)) continue;
    if (!found.empty()) return "";
    found = candidate;
  }
  return found;
}

}  // namespace

std::string NearestOf(std::string_view word, const std::vector<std::string>& candidates) {
  if (word.empty() || word.size() > kLongestWord) return "";
  size_t least = std::max<size_t>(1, word.size() / 3) + 1;
  for (const std::string& candidate : candidates) {
    least = std::min(least, Distance(word, candidate));
  }
  if (least <= std::max<size_t>(1, word.size() / 3)) {
    return OnlyOne(candidates, [&](const std::string& c) { return Distance(word, c) == least; });
  }
  return OnlyOne(candidates, [&](const std::string& c) { return c.starts_with(word); });
}

}  // namespace myograde::server
