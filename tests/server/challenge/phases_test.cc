// Phases: what each plays, in what state it is, and which one a submission belongs to.
#include "server/challenge/phases.h"

#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/base/sha256.h"
#include "protocol/lease/seed_commitment.h"
#include "server/base/error_code.h"
#include "server/proof/seed_list.h"
#include "tests/server/challenge/challenge_world.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Json = nlohmann::json;

const char* const kFirst = "2026-12-01T00:00:00Z";
const char* const kSecond = "2026-12-02T00:00:00Z";
const char* const kThird = "2026-12-03T00:00:00Z";
const char* const kFourth = "2026-12-04T00:00:00Z";

absl::StatusOr<std::string> SecretFor(const PhaseConfig& phase) {
  return std::string(32, phase.name.front());
}

Phases MakePhases(const std::vector<Json>& phases) {
  absl::StatusOr<Phases> made = Phases::Make({ChallengeOf(phases)}, ShippedTracks(), SecretFor);
  EXPECT_TRUE(made.ok()) << made.status();
  return std::move(made).value_or(Phases());
}

PhaseEventRow Event(const std::string& phase, const char* event, const std::string& why = "why") {
  return {{1, 1, "uid 0", why}, phase, event};
}

BoardState StateAfter(const std::vector<PhaseEventRow>& events) {
  BoardState state;
  for (const PhaseEventRow& event : events) {
    const absl::Status added = state.Add(
        {.id = state.last() + 1,
         .at = event.at,
         .kind = kPhaseAct,
         .who = event.who,
         .content = {{"phase", event.phase}, {"event", event.event}, {"why", event.why}}});
    EXPECT_TRUE(added.ok()) << added;
  }
  return state;
}

PhaseConfig ConfigWith(const Json& more) { return ChallengeOf({PhaseJson("final", more)}).phases[0]; }

TEST(Phases, WithoutAChallengeThereIsNone) {
  const Phases none;
  EXPECT_FALSE(none.any());
  EXPECT_THAT(none.entries(), IsEmpty());
  EXPECT_EQ(ErrorCodeOf(none.Find("final").status()), "unknown_phase");
  EXPECT_EQ(none.ConfigOf(""), nullptr);
}

TEST(Phases, APublicOneIsItsTrackWithNameSeedsAndRule) {
  const Phases phases =
      MakePhases({PhaseJson("final", {{"seeds", {500, 600}}, {"entry", "last"}})});
  const absl::StatusOr<PhasePtr> phase = phases.Find("final");
  ASSERT_TRUE(phase.ok()) << phase.status();
  const TrackConfig& own = (*phase)->track->config;
  const TrackConfig& track = (*ShippedTracks().Find(kArm, kProfile))->config;
  EXPECT_EQ(own.phase, "final");
  EXPECT_EQ(own.seeds, (std::vector<uint64_t>{500, 600}));
  EXPECT_EQ(own.policy_seed_secret, track.policy_seed_secret);
  EXPECT_EQ(own.seed_salt, "");
  EXPECT_EQ((*phase)->track->scoring.team, scoring::TeamRule::kLast);
  EXPECT_EQ((*phase)->commitment, "");
  EXPECT_EQ(own.rules, track.rules);
  EXPECT_NE(own.hash, track.hash);
}

TEST(Phases, ThoseWithTheTracksOwnSeedsHaveBoardsOfTheirOwn) {
  const Phases phases = MakePhases({PhaseJson("a"), PhaseJson("b")});
  std::set<std::string> hashes = {(*ShippedTracks().Find(kArm, kProfile))->config.hash};
  for (const PhasePtr& phase : phases.entries()) hashes.insert(phase->track->config.hash);
  EXPECT_EQ(hashes.size(), 3u);
}

TEST(Phases, ACommittedOnePlaysWhatItsSecretGives) {
  const Phases phases = MakePhases({PhaseJson("final", {{"seeds", {{"committed", 7}}}})});
  const Phase& phase = *phases.entries().front();
  const std::string secret(32, 'f');
  const PhaseSecrets secrets = SecretsOfPhase(secret, "final");
  EXPECT_EQ(phase.track->config.seeds, DeriveSeeds(secret, "final", 7));
  EXPECT_EQ(phase.track->config.policy_seed_secret, secrets.policy_seed_secret);
  EXPECT_EQ(phase.track->config.seed_salt, secrets.seed_salt);
  EXPECT_EQ(phase.commitment, Sha256Hex(absl::BytesToHexString(secret)));
}

TEST(Phases, OneWithoutItsSecretStaysShutAndIsNotForgotten) {
  const auto refuse = [](const PhaseConfig&) -> absl::StatusOr<std::string> {
    return absl::DataLossError("the secret is damaged");
  };
  const absl::StatusOr<Phases> phases =
      Phases::Make({ChallengeOf({PhaseJson("final", {{"seeds", {{"committed", 7}}}})})},
                   ShippedTracks(), refuse);
  ASSERT_TRUE(phases.ok()) << phases.status();
  EXPECT_TRUE(phases->any());
  EXPECT_THAT(phases->entries(), IsEmpty());
  EXPECT_TRUE(absl::IsDataLoss(phases->Find("final").status()));
  EXPECT_NE(phases->ConfigOf("final"), nullptr);
  EXPECT_TRUE(HasPhases(*phases, kArm));
}

TEST(Phases, TheyAreInOrderOfOpening) {
  const Phases phases = MakePhases({PhaseJson("c", {{"opens_at", kSecond}}),
                                    PhaseJson("b", {{"opens_at", kFirst}}),
                                    PhaseJson("a", {{"opens_at", kSecond}}), PhaseJson("z")});
  std::string order;
  for (const PhasePtr& phase : phases.entries()) order += phase->config.name;
  EXPECT_EQ(order, "zbac");
}

// Those of a folder, as the daemon takes them.
absl::StatusOr<Phases> LoadPhases(const std::string& dir) {
  std::vector<std::string> mistakes;
  std::vector<ChallengeConfig> challenges = ReadChallenges(dir, mistakes);
  if (mistakes.empty()) {
    mistakes = CheckChallenges(challenges, ShippedTracks(), absl::InfinitePast()).mistakes;
  }
  if (!mistakes.empty()) return MistakesToStatus(mistakes);
  return Phases::Make(std::move(challenges), ShippedTracks(), SecretFor);
}

class PhasesFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "phases-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }

  void Write(const std::string& file, const std::string& text) {
    std::ofstream(dir_ + "/" + file) << text;
  }
  std::string Mistake() { return std::string(LoadPhases(dir_).status().message()); }

  std::string dir_;
};

TEST_F(PhasesFolder, EveryFileIsLoaded) {
  Write("spring.json", ChallengeJson({PhaseJson("a")}).dump());
  Write("autumn.json", ChallengeJson({PhaseJson("b", {{"seeds", {700}}})}).dump());
  Write("README.md", "not a challenge");
  Write(".#spring.json", "an editor's");
  const absl::StatusOr<Phases> phases = LoadPhases(dir_);
  ASSERT_TRUE(phases.ok()) << phases.status();
  EXPECT_TRUE(phases->any());
  ASSERT_EQ(phases->entries().size(), 2u);
  EXPECT_EQ(phases->challenges()[0].name, "autumn");
}

TEST_F(PhasesFolder, AHostMayGiveATextAndALogo) {
  Write("spring.json", ChallengeJson({PhaseJson("a")}).dump());
  EXPECT_TRUE(LoadPhases(dir_)->challenges()[0].logo.empty());
  Write("spring.md", "Be *quick*.");
  const std::string logo = "\x89PNG\r\n\x1a\n and so on";
  Write("spring.png", logo);
  const absl::StatusOr<Phases> phases = LoadPhases(dir_);
  ASSERT_TRUE(phases.ok()) << phases.status();
  EXPECT_EQ(phases->challenges()[0].logo, logo);
  EXPECT_EQ(phases->challenges()[0].text.size(), 1u);
  Write("spring.png", "<svg onload=\"alert(1)\"/>");
  EXPECT_THAT(Mistake(), HasSubstr("spring.png: the challenge's logo is not a PNG"));
  Write("spring.png", logo + std::string(256 << 10, 'x'));
  EXPECT_THAT(Mistake(), HasSubstr("spring.png"));
}

TEST_F(PhasesFolder, AMissingFolderIsNoChallenge) {
  const auto phases = LoadPhases(dir_ + "/none");
  ASSERT_TRUE(phases.ok()) << phases.status();
  EXPECT_FALSE(phases->any());
}

TEST_F(PhasesFolder, NoFileIsIgnoredByMistake) {
  Write("Final.json", ChallengeJson({PhaseJson("a")}).dump());
  EXPECT_THAT(Mistake(), HasSubstr("Final.json: the file's name is that of the challenge"));
  std::filesystem::remove(dir_ + "/Final.json");
  Write("final.json", "{");
  EXPECT_THAT(Mistake(), HasSubstr("final.json"));
  Write("final.json", ChallengeJson({PhaseJson("a", {{"track", "flying"}})}).dump());
  EXPECT_THAT(Mistake(), HasSubstr("final.json: phase \"a\""));
}

TEST(PhaseState, TheCalendarOpensAndCloses) {
  const PhaseConfig phase = ConfigWith({{"opens_at", kSecond}, {"closes_at", kThird}});
  const auto state = [&](absl::Time now) { return StatusOfPhase(phase, {}, now).state; };
  const absl::Duration moment = absl::Milliseconds(1);
  EXPECT_EQ(state(At(kSecond) - moment), PhaseState::kUpcoming);
  EXPECT_EQ(state(At(kSecond)), PhaseState::kOpen);
  EXPECT_EQ(state(At(kThird) - moment), PhaseState::kOpen);
  EXPECT_EQ(state(At(kThird)), PhaseState::kClosed);
  EXPECT_THAT(std::string(CheckOpen(phase, At(kFirst)).message()),
              HasSubstr(absl::StrCat("opens at ", kSecond)));
  EXPECT_THAT(std::string(CheckOpen(phase, At(kFourth)).message()),
              HasSubstr(absl::StrCat("closed at ", kThird)));
  EXPECT_EQ(ErrorCodeOf(CheckOpen(phase, At(kFourth))), "phase_closed");
}

TEST(PhaseState, APauseOfThePhaseOrOfAllPausesIt) {
  const PhaseConfig phase = ConfigWith({});
  BoardState board;
  const auto state = [&](const std::vector<PhaseEventRow>& events) {
    board = StateAfter(events);
    return StatusOfPhase(phase, board, At(kFirst));
  };
  EXPECT_EQ(state({Event("other", kPausedEvent)}).state, PhaseState::kOpen);
  EXPECT_EQ(state({Event("final", kPausedEvent, "broken")}).pause->why, "broken");
  EXPECT_EQ(state({Event("", kPausedEvent)}).state, PhaseState::kPaused);
  EXPECT_EQ(state({Event("", kPausedEvent), Event("final", kResumedEvent)}).state,
            PhaseState::kPaused);
  EXPECT_EQ(state({Event("final", kPausedEvent), Event("", kResumedEvent)}).state,
            PhaseState::kPaused);
  EXPECT_EQ(state({Event("final", kPausedEvent), Event("final", kResumedEvent)}).state,
            PhaseState::kOpen);
}

TEST(PhaseState, ABoardIsFrozenUntilItIsPublishedOrRevealed) {
  const PhaseConfig phase = ConfigWith({{"freeze_at", kSecond}, {"closes_at", kThird}});
  const auto frozen = [&](const char* now, const std::vector<PhaseEventRow>& events) {
    return StatusOfPhase(phase, StateAfter(events), At(now)).frozen;
  };
  EXPECT_FALSE(frozen(kFirst, {}));
  EXPECT_TRUE(frozen(kSecond, {}));
  EXPECT_TRUE(frozen(kFourth, {})) << "closing publishes nothing";
  EXPECT_TRUE(frozen(kFourth, {Event("other", kPublishedEvent)}));
  EXPECT_FALSE(frozen(kFourth, {Event("final", kPublishedEvent)}));
  EXPECT_FALSE(frozen(kFourth, {Event("final", kRevealedEvent)}));
  EXPECT_FALSE(StatusOfPhase(ConfigWith({}), {}, At(kFourth)).frozen);
}

TEST(PhaseState, IsTheCalendarsWhateverHappenedElsewhere) {
  EXPECT_TRUE(rc::check([] {
    PhaseConfig phase;
    phase.name = "final";
    phase.opens = absl::FromUnixSeconds(*rc::gen::inRange(0, 100));
    phase.closes = phase.opens + absl::Seconds(*rc::gen::inRange(1, 100));
    const absl::Time now = absl::FromUnixSeconds(*rc::gen::inRange(-50, 250));
    const auto events = *rc::gen::container<std::vector<PhaseEventRow>>(
        rc::gen::map(rc::gen::pair(rc::gen::element("", "final", "other"),
                                   rc::gen::element(kPausedEvent + 0, kResumedEvent + 0)),
                     [](const auto& pair) { return Event(pair.first, pair.second); }));
    const auto paused = [&](const char* scope) {
      const auto last = std::find_if(events.rbegin(), events.rend(),
                                     [&](const auto& event) { return event.phase == scope; });
      return last != events.rend() && last->event == kPausedEvent;
    };
    const PhaseState state = StatusOfPhase(phase, StateAfter(events), now).state;
    RC_ASSERT((state == PhaseState::kUpcoming) == (now < phase.opens));
    RC_ASSERT((state == PhaseState::kClosed) == (now >= phase.closes));
    RC_ASSERT(CheckOpen(phase, now).ok() ==
              (state == PhaseState::kOpen || state == PhaseState::kPaused));
    if (CheckOpen(phase, now).ok()) {
      RC_ASSERT((state == PhaseState::kPaused) == (paused("") || paused("final")));
    }
  }));
}

class FindPhaseTest : public ::testing::Test {
 protected:
  std::string Found(const PhaseQuery& query, const char* now) {
    const absl::StatusOr<PhasePtr> phase = FindPhase(phases_, query, At(now));
    if (phase.ok()) return (*phase)->config.name;
    const std::string code = ErrorCodeOf(phase.status());
    return absl::StrCat(code.empty() ? "bad_request" : code, ": ",
                        std::string(phase.status().message()));
  }

  const Phases phases_ = MakePhases({
      PhaseJson("early", {{"opens_at", kFirst}, {"closes_at", kSecond}}),
      PhaseJson("late", {{"opens_at", kThird}, {"closes_at", kFourth}, {"seeds", {500}}}),
      PhaseJson("same-time", {{"opens_at", kThird}, {"seeds", {600}}, {"profile", "myosuite"}}),
  });
};

TEST_F(FindPhaseTest, TheOnlyOpenOneNeedsNoName) {
  EXPECT_EQ(Found({"", kArm, ""}, kFirst), "early");
  EXPECT_EQ(Found({"", kArm, kProfile}, kThird), "late");
  EXPECT_THAT(Found({"", kArm, ""}, kThird), HasSubstr("bad_request: track \"manipulation\" has 2 "
                                                       "open phases; name one as \"phase\": late, "
                                                       "same-time"));
}

TEST_F(FindPhaseTest, WhereNoneIsOpenTheNextOneIsNamed) {
  EXPECT_THAT(Found({"", kArm, ""}, kSecond),
              HasSubstr(absl::StrCat("\"late\" opens at ", kThird)));
  EXPECT_THAT(Found({"", kArm, kProfile}, kFourth), HasSubstr("none opens later"));
  EXPECT_THAT(Found({"", kArm, ""}, kSecond), HasSubstr("phase_closed: "));
}

TEST_F(FindPhaseTest, ANamedOneIsFoundWhateverItsState) {
  for (const char* now : {kFirst, kSecond, kFourth}) {
    EXPECT_EQ(Found({"early", kArm, ""}, now), "early");
  }
  EXPECT_THAT(Found({"gone", kArm, ""}, kFirst), HasSubstr("known: early, late, same-time"));
  EXPECT_THAT(Found({"early", kLeg, ""}, kFirst), HasSubstr("is of track \"manipulation\""));
  EXPECT_THAT(Found({"early", kArm, "myosuite"}, kFirst), HasSubstr("in the profile \"paper\""));
}

TEST_F(FindPhaseTest, OnlyItsOwnTrackNeedsAPhase) {
  EXPECT_TRUE(HasPhases(phases_, kArm));
  EXPECT_FALSE(HasPhases(phases_, kLeg));
}

TEST(PhaseStateName, IsAWordOfTheApi) {
  EXPECT_EQ(PhaseStateName(PhaseState::kUpcoming), "upcoming");
  EXPECT_EQ(PhaseStateName(PhaseState::kClosed), "closed");
}

}  // namespace
}  // namespace myograde::server
