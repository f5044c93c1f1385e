// Submissions to the phases of a challenge: which phase each belongs to, and which are refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/base/error_code.h"
#include "tests/server/admission/admission_world.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

// Hours after the start of the world's clock.
constexpr int kOpens = 10;
constexpr int kCloses = 20;

class SubmitPhaseTest : public AdmissionWorld {
 protected:
  absl::Time Hour(int hours) const { return start_ + absl::Hours(hours); }

  Json PhaseJson(const std::string& name, int first_seed, const Json& more = {}) const {
    Json phase = {{"name", name},
                  {"title", "A phase"},
                  {"track", kTrack},
                  {"profile", "paper"},
                  {"seeds", {{"first", first_seed}, {"count", 4}}},
                  {"opens_at", UtcText(Hour(kOpens))},
                  {"closes_at", UtcText(Hour(kCloses))}};
    if (more.is_object()) phase.update(more);
    return phase;
  }

  void Hold(const std::vector<Json>& phases) {
    std::vector<std::string> mistakes;
    const ChallengeConfig challenge = ReadChallenge(
        {{"form", 1}, {"title", "A cup"}, {"phases", phases}}, "cup", "cup.json", mistakes);
    ASSERT_TRUE(mistakes.empty()) << mistakes.front();
    ASSERT_TRUE(CheckChallenges({challenge}, *tracks_, absl::InfinitePast()).mistakes.empty());
    const auto secret = [](const PhaseConfig&) { return std::string(32, 's'); };
    auto made = Phases::Make({challenge}, *tracks_, secret);
    ASSERT_TRUE(made.ok()) << made.status();
    phases_ = *std::move(made);
    admission();  // starts the engine, which reads a clock that the tests don't set
    at_ = std::make_unique<Admission>(options_, *tracks_, phases_, *engine_, *readers_, calendar_);
  }

  void SetTo(int hours) { calendar_.Jump(Hour(hours) - calendar_.Now()); }

  absl::StatusOr<Accepted> To(const std::string& phase, char artefact,
                              const std::string& team = "alpha") {
    return at_->Submit({.artefact = std::string(64, artefact),
                        .team = team,
                        .track = kTrack,
                        .profile = "",
                        .phase = phase,
                        .seeds = std::nullopt,
                        .episodes = std::nullopt},
                       "uid 7");
  }
  absl::StatusOr<Accepted> Practise(char artefact, const std::string& phase = "") {
    return at_->Submit({.artefact = std::string(64, artefact),
                        .team = "alpha",
                        .track = kTrack,
                        .profile = "",
                        .phase = phase,
                        .seeds = std::nullopt,
                        .episodes = 2},
                       "uid 7");
  }
  std::string CodeOf(const std::string& phase, char artefact = 'a') {
    return ErrorCodeOf(To(phase, artefact).status());
  }

  const absl::Time start_ = clock_.Now();
  ManualClock calendar_{start_};
  std::unique_ptr<Admission> at_;
};

TEST_F(SubmitPhaseTest, ThePhasesConfigIsPlayed) {
  Hold({PhaseJson("final", 700, {{"entry", "last"}})});
  AddArtefact('a');
  SetTo(kOpens);
  const auto accepted = To("final", 'a');
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  const SubmissionRow row = FindSubmission(*accepted);
  EXPECT_EQ(row.phase, "final");
  EXPECT_TRUE(row.ranked);
  EXPECT_EQ(row.config, (*phases_.Find("final"))->track->config.hash);
  EXPECT_NE(row.config, (*tracks_->Find(kTrack, ""))->config.hash);
}

TEST_F(SubmitPhaseTest, APhaseMayBeForSomeTeamsOnly) {
  Hold({PhaseJson("final", 700, {{"teams", {"beta", "gamma"}}}), PhaseJson("open", 800)});
  for (const char artefact : {'a', 'b', 'c'}) AddArtefact(artefact);
  SetTo(kOpens);
  const absl::Status refused = To("final", 'a', "alpha").status();
  EXPECT_EQ(ErrorCodeOf(refused), "forbidden");
  EXPECT_THAT(refused.message(), HasSubstr("open to 2 teams"));
  EXPECT_EQ(Count("submission"), 0);
  EXPECT_TRUE(To("final", 'b', "beta").ok());
  EXPECT_TRUE(To("open", 'c', "alpha").ok());
  EXPECT_TRUE(Practise('a').ok()) << "practice is granted by track";
}

TEST_F(SubmitPhaseTest, TheCalendarLetsInBetweenOpeningAndClose) {
  Hold({PhaseJson("final", 700)});
  AddArtefact('a');
  for (const char* name : {"final", ""}) {
    SetTo(kOpens - 1);
    EXPECT_EQ(CodeOf(name), "phase_closed");
    SetTo(kCloses);
    EXPECT_EQ(CodeOf(name), "phase_closed");
  }
  EXPECT_EQ(Count("submission"), 0);
  SetTo(kCloses - 1);
  const auto accepted = To("", 'a');
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  EXPECT_EQ(FindSubmission(*accepted).phase, "final");
}

TEST_F(SubmitPhaseTest, WhatWasAcceptedIsFoundAfterTheClose) {
  Hold({PhaseJson("final", 700)});
  AddArtefact('a');
  SetTo(kOpens);
  const auto accepted = To("final", 'a');
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  SetTo(kCloses + 1);
  const auto again = To("final", 'a');
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_EQ(again->submission, accepted->submission);
}

TEST_F(SubmitPhaseTest, PracticeBelongsToNoPhaseAndIsAlwaysOpen) {
  Hold({PhaseJson("final", 700)});
  AddArtefact('a');
  const auto accepted = Practise('a');
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  const SubmissionRow row = FindSubmission(*accepted);
  EXPECT_EQ(row.phase, "");
  EXPECT_FALSE(row.ranked);
  SetTo(kOpens);
  const auto both = Practise('a', "final");
  EXPECT_TRUE(absl::IsInvalidArgument(both.status())) << both.status();
  EXPECT_THAT(std::string(both.status().message()), HasSubstr("played as a whole"));
}

TEST_F(SubmitPhaseTest, TheTracksOwnSeedsDoNotRankWhereItHasPhases) {
  Hold({PhaseJson("final", 700)});
  AddArtefact('a');
  const auto sneaked = at_->Submit({.artefact = std::string(64, 'a'),
                                    .team = "alpha",
                                    .track = kTrack,
                                    .profile = "",
                                    .seeds = (*tracks_->Find(kTrack, ""))->config.seeds,
                                    .episodes = std::nullopt},
                                   "uid 7");
  EXPECT_TRUE(!sneaked.ok() || !FindSubmission(*sneaked).ranked);
}

TEST_F(SubmitPhaseTest, APhasesQuotaIsItsOwn) {
  Hold({PhaseJson("small", 700, {{"quota", {{"official_total", 1}}}}), PhaseJson("large", 800)});
  SetTo(kOpens);
  for (const char artefact : {'a', 'b'}) AddArtefact(artefact);
  ASSERT_TRUE(To("small", 'a').ok());
  EXPECT_EQ(CodeOf("small", 'b'), "quota");
  EXPECT_TRUE(To("large", 'b').ok());
  EXPECT_THAT(std::string(To("", 'a').status().message()), HasSubstr("has 2 open phases"));
}

TEST_F(SubmitPhaseTest, APauseIsOfThePhaseOrOfAll) {
  Hold({PhaseJson("one", 700), PhaseJson("two", 800)});
  SetTo(kOpens);
  AddArtefact('a');
  const auto act = [&](const std::string& phase, const char* event) {
    const absl::Status status = engine_->Change(
        [=](Transaction& writer) {
          return writer.phases.AddEvent(phase, event, "uid 0", "why").status();
        },
        absl::Minutes(1));
    ASSERT_TRUE(status.ok()) << status;
  };
  act("one", kPausedEvent);
  EXPECT_EQ(CodeOf("one"), "paused");
  act("", kPausedEvent);
  EXPECT_EQ(CodeOf("two"), "paused");
  EXPECT_EQ(ErrorCodeOf(Practise('a').status()), "paused");
  act("", kResumedEvent);
  EXPECT_TRUE(To("two", 'a').ok());
  EXPECT_EQ(CodeOf("one"), "paused");
}

// However the calendar is set, each answer agrees with it, and each accepted submission is there
// once.
TEST_F(SubmitPhaseTest, NoJumpOfTheCalendarLosesOrRepeatsASubmission) {
  options_.config.quota.defaults.quota = {
      .ranked = {1000, 1000}, .practice = {9, 9}, .failed = {9, 9}, .waiting = 1000};
  Hold({PhaseJson("final", 700)});
  for (const char artefact : {'a', 'b', 'c'}) AddArtefact(artefact);
  int teams = 0;
  EXPECT_TRUE(rc::check([&] {
    const std::string team = absl::StrCat("team ", ++teams);
    const int64_t before = Count("submission");
    std::map<char, int64_t> accepted;
    const auto steps = *rc::gen::resize(15, rc::gen::container<std::vector<std::pair<int, char>>>(
        rc::gen::pair(rc::gen::inRange(0, 30), rc::gen::element('a', 'b', 'c'))));
    for (const auto& [hour, artefact] : steps) {
      SetTo(hour);
      const bool open = hour >= kOpens && hour < kCloses;
      const auto answer = To("final", artefact, team);
      const auto known = accepted.find(artefact);
      if (known != accepted.end()) {
        RC_ASSERT(answer.ok() && answer->linked && answer->submission == known->second);
      } else if (open) {
        RC_ASSERT(answer.ok() && !answer->linked);
        accepted[artefact] = answer->submission;
      } else {
        RC_ASSERT(ErrorCodeOf(answer.status()) == "phase_closed");
      }
    }
    RC_ASSERT(Count("submission") - before == static_cast<int64_t>(accepted.size()));
  }));
}

}  // namespace
}  // namespace myograde::server
