#include "scoring/standing.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::scoring {
namespace {

using ::testing::ElementsAre;

// A submission: its team, what opens a band (a later one is in it up to a tenth more), and what counts
// inside; its acceptance number is its place in the list.
struct Handed {
  size_t team;
  double value;
  size_t inside;
};

// The acceptance numbers of those that stand, in the order of bands.
std::vector<int64_t> StandingOf(const std::vector<Handed>& handed) {
  std::vector<BandCandidate> candidates;
  for (const Handed& one : handed) {
    candidates.push_back({one.team, std::ssize(candidates) + 1, one.value, one.inside});
  }
  std::sort(candidates.begin(), candidates.end(), [](const BandCandidate& a, const BandCandidate& b) {
    return std::pair(a.value, a.acceptance) < std::pair(b.value, b.acceptance);
  });
  std::vector<int64_t> standing;
  for (const size_t place : StandingEntries(candidates, [](double value, double opener) {
         return value <= 1.1 * opener;
       })) {
    standing.push_back(candidates[place].acceptance);
  }
  return standing;
}

TEST(StandingEntries, AnOlderSubmissionAnswersTheEntryOfAnother) {
  // 1 outranks 4, and 2 does not; as long as 3 stood, 1 and 2 were alike.
  EXPECT_THAT(StandingOf({{0, 9.36, 1}, {0, 8.00, 9}, {1, 8.96, 5}, {1, 8.64, 7}}),
              ElementsAre(4, 1));
}

TEST(StandingEntries, WhereEachAnswerHasAnAnswerTheOthersKeepTheirs) {
  // 4 answers 1, 2 answers 4, 3 answers 2, and 1 answers 3.
  EXPECT_THAT(StandingOf({{0, 109, 4}, {0, 116, 2}, {1, 126, 1}, {1, 109, 3}}), ElementsAre(1, 4));
}

}  // namespace
}  // namespace myograde::scoring
