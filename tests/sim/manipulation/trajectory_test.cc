// The official rule over an episode's contacts, from the frames to the verdict:
// the simulator counts, scoring judges.
#include <gtest/gtest.h>

#include "scoring/manipulation/judge.h"
#include "tests/sim/golden.h"
#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

// Frames of a run-length coded history: [["MP", 5], ...].
ContactHistory Play(const json& runs, const json& labels, int64_t hold_frames) {
  ContactHistory history(hold_frames);
  for (const json& run : runs) {
    TouchFrame frame = {};
    for (const char letter : run[0].get<std::string>()) {
      frame[labels.at(std::string(1, letter)).get<int>()] = true;
    }
    for (int i = 0; i < run[1].get<int>(); ++i) history.Add(frame);
  }
  return history;
}

// The verdict on an episode whose object was solved in all but its contacts.
FailureReason Verdict(const ContactHistory& history) {
  EpisodeFacts episode;
  episode.end = ManipulationEnd::kPlaced;
  episode.steps = 500;
  ManipulationFacts facts;
  facts.solved = true;
  facts.placed = true;
  history.Report(facts);
  episode.track = facts;
  scoring::ManipulationJudging rules;
  rules.success = scoring::SuccessRule::kSolvedAndContact;
  rules.force_enforced = false;
  const auto verdict = scoring::Judge(episode, rules);
  EXPECT_EQ(verdict.outcome == Outcome::kSuccess, verdict.reason == FailureReason::kNone);
  return verdict.reason;
}

TEST(ContactTrajectory, VerdictsAreTheOfficialOnes) {
  const int64_t hold = RulesOf("myosuite").hold_frames;
  int checked = 0;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("labels") || !file.json.contains("cases")) continue;
    for (const json& golden : file.json.at("cases")) {
      const FailureReason verdict =
          Verdict(Play(golden.at("rle"), file.json.at("labels"), hold));
      const std::string want =
          golden.at("result").is_null() ? "OK" : golden.at("result").get<std::string>();
      const FailureReason reason = want == "OK"            ? FailureReason::kNone
                                   : want == "ENV_CONTACT" ? ManipulationReason::kContact
                                                           : ManipulationReason::kHandover;
      EXPECT_EQ(verdict.name(), reason.name())
          << file.name << ": " << golden.at("desc") << ", golden " << want;
      ++checked;
    }
  }
  if (checked == 0) GTEST_SKIP() << "no golden file of contact histories in the folder";
}

TEST(ContactTrajectory, EveryBranch) {
  const json labels = {{"M", 0}, {"P", 1}, {"S", 2}, {"G", 3}, {"E", 4}};
  const std::pair<const char*, FailureReason> histories[] = {
      {R"([["M", 100], ["P", 100], ["G", 8]])", FailureReason::kNone},
      {R"([["M", 99], ["P", 100], ["G", 8]])", ManipulationReason::kHandover},
      {R"([["M", 100], ["P", 99], ["G", 8]])", ManipulationReason::kHandover},
      {R"([["M", 100], ["P", 100], ["G", 7]])", ManipulationReason::kHandover},
      {R"([["M", 100], ["P", 100], ["G", 8], ["PG", 1]])", ManipulationReason::kHandover},
      {R"([["E", 1], ["M", 100], ["P", 100], ["G", 8]])", ManipulationReason::kContact}};
  for (const auto& [runs, want] : histories) {
    EXPECT_EQ(Verdict(Play(json::parse(runs), labels, 8)), want) << runs;
  }
}

}  // namespace
}  // namespace myograde::sim
