// Which config each board has after a start: that of its file, or of a rejudge.
#include "server/challenge/phases.h"

#include <filesystem>
#include <fstream>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "tests/server/challenge/challenge_world.h"

namespace myograde::server {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr char kFinal[] = "final";

// The same track with another limit.
TrackPtr Changed(const TrackPtr& track, int64_t files) {
  nlohmann::json effective = track->config.effective;
  effective["budgets"]["submission_files"] = files;
  return *MakeTrack(*ParseTrackConfig(effective, "test"));
}

absl::StatusOr<std::string> Sign(const std::string&) { return std::string(128, 'a'); }

// A daemon's configs and store, started as often as wanted.
class BoardConfigsTest : public testing::Test {
 protected:
  BoardConfigsTest() {
    std::string name = (std::filesystem::temp_directory_path() / "configs-XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    store_ = *Store::Open(dir_ + "/store.db", clock_);
    readers_ = std::make_unique<ReaderPool>(dir_ + "/store.db");
    Start();
  }
  ~BoardConfigsTest() override { std::filesystem::remove_all(dir_); }

  // Files whose arm track allows `files` files, with or without a phase on it.
  Overlaid Start(int64_t files = 0, bool with_phase = true) {
    tracks_ = std::make_unique<Tracks>(*Tracks::Load(MYOGRADE_SOURCE_DIR "/configs/tracks"));
    if (files != 0) {
      EXPECT_TRUE(tracks_->Replace(Changed(*tracks_->Find(kArm, kProfile), files)).ok());
    }
    std::vector<ChallengeConfig> challenges;
    if (with_phase) {
      challenges.push_back(ChallengeOf({PhaseJson(kFinal, {{"seeds", {500, 600}}})}));
    }
    phases_ = std::make_unique<Phases>(*Phases::Make(
        challenges, *tracks_, [](const PhaseConfig&) { return std::string(32, 's'); }));
    absl::StatusOr<Overlaid> overlaid = absl::InternalError("");
    Read([&](const Transaction& reader) { overlaid = OverlayConfigs(reader, *tracks_, *phases_); });
    EXPECT_TRUE(overlaid.ok()) << overlaid.status();
    for (const NewBoardConfig& change : overlaid->changed) {
      Write([&](Transaction& writer) {
        return writer.journal.SetBoardConfig(change, "daemon").status();
      });
    }
    return *overlaid;
  }
  TrackPtr Arm() const { return *tracks_->Find(kArm, kProfile); }
  TrackPtr Final() const { return (*phases_->Find(kFinal))->track; }

  // A ranked submission, so that the board has a config.
  void Submit(const TrackPtr& track) {
    const TrackConfig& config = track->config;
    Write([&](Transaction& writer) {
      const std::string artefact = Sha256Hex(config.hash);
      EXPECT_TRUE(writer.content.AddArtefact({{"walker", {"./policy"}}, artefact, 10, 2}).ok());
      NewSubmission submission;
      submission.team = "alpha";
      submission.artefact = artefact;
      submission.track = config.id;
      submission.profile = config.profile;
      submission.config = config.hash;
      submission.config_json = CanonicalJson(config.effective);
      submission.seeds = Sha256Hex("[1]");
      submission.seeds_json = "[1]";
      submission.ranked = true;
      submission.grader_json = "{}";
      submission.blocks = {{0, 0}};
      submission.phase = config.phase;
      return writer.submissions
          .Accept(submission,
                  {.quota = {.ranked = {9, 9}, .practice = {9, 9}, .failed = {9, 9}, .waiting = 9}},
                  "uid 0")
          .status();
    });
  }
  // A rejudge that is applied, of a board that has nothing to judge yet.
  void Rejudge(const TrackPtr& from, const TrackPtr& to) {
    NewRejudge rejudge;
    rejudge.board = {from->config.phase, from->config.id, from->config.profile};
    rejudge.from_config = from->config.hash;
    rejudge.from_config_json = CanonicalJson(from->config.effective);
    rejudge.to_config = to->config.hash;
    rejudge.to_config_json = CanonicalJson(to->config.effective);
    rejudge.seeds = Sha256Hex("[1]");
    rejudge.seeds_json = "[1]";
    rejudge.why = "the rules change";
    Write([&](Transaction& writer) -> absl::Status {
      const absl::StatusOr<RejudgeRow> made = writer.rejudges.Add(rejudge, Sign, "uid 0");
      if (!made.ok()) return made.status();
      return writer.rejudges
          .End(/*apply=*/true, {.rejudge = made->id, .why = "a vote"}, Sign, "uid 0")
          .status();
    });
  }
  void Drop(int64_t rejudge) {
    Write([&](Transaction& writer) {
      return writer.rejudges
          .End(/*apply=*/false, {.rejudge = rejudge, .why = "an appeal"}, Sign, "uid 0")
          .status();
    });
  }
  void Read(const std::function<void(const Transaction&)>& body) {
    const absl::Status status = readers_->Read([&](const Transaction& reader) {
      body(reader);
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
  }
  void Write(const std::function<absl::Status(Transaction&)>& change) {
    const absl::Status status = store_->Write(change);
    EXPECT_TRUE(status.ok()) << status;
  }
  std::vector<BoardConfigRow> Rows() {
    std::vector<BoardConfigRow> rows;
    Read([&](const Transaction& reader) { rows = reader.Board().ConfigsOf({"", kArm, kProfile}); });
    return rows;
  }

  ManualClock clock_{absl::FromUnixSeconds(1700000000)};
  std::string dir_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  std::unique_ptr<Tracks> tracks_;
  std::unique_ptr<Phases> phases_;
};

TEST_F(BoardConfigsTest, ARejudgesConfigOutlivesTheDaemon) {
  const std::string of_file = Arm()->config.hash;
  const TrackPtr to = Changed(Arm(), 77);
  Rejudge(Arm(), to);
  const Overlaid overlaid = Start();
  EXPECT_EQ(Arm()->config.hash, to->config.hash);
  EXPECT_THAT(overlaid.notes, SizeIs(1));
  EXPECT_THAT(overlaid.changed, IsEmpty());
  EXPECT_FALSE(Arm()->config.practice_seeds.empty()) << "it is practised on as before";
  Drop(1);
  Start();
  EXPECT_EQ(Arm()->config.hash, of_file);
}

TEST_F(BoardConfigsTest, AFileThatSaysTheSameAsTheRejudgeChangesNothing) {
  const TrackPtr old = Arm();
  const TrackPtr to = Changed(old, 77);
  Rejudge(old, to);
  const Overlaid overlaid = Start(77);
  EXPECT_EQ(Arm()->config.hash, to->config.hash);
  EXPECT_THAT(overlaid.warnings, IsEmpty());
  Drop(1);
  Start(77);
  EXPECT_EQ(Arm()->config.hash, old->config.hash) << "the file was changed for what was dropped";
}

TEST_F(BoardConfigsTest, AFileThatSaysSomethingNewWins) {
  Rejudge(Arm(), Changed(Arm(), 77));
  const Overlaid overlaid = Start(88);
  EXPECT_EQ(Arm()->config.budgets.submission_files, 88);
  ASSERT_THAT(overlaid.warnings, SizeIs(1));
  EXPECT_THAT(overlaid.warnings.front(), HasSubstr("was changed after it got submissions"));
  ASSERT_THAT(Rows(), SizeIs(2));
  EXPECT_EQ(Rows().back().rejudge, 0);
  EXPECT_THAT(Start(88).warnings, IsEmpty()) << "it is said once";
  Start();
  EXPECT_THAT(Rows(), SizeIs(3)) << "the file is as it was before the rejudge, which is new by now";
}

TEST_F(BoardConfigsTest, OneRejudgeFollowsAnother) {
  const TrackPtr first = Changed(Arm(), 77);
  Rejudge(Arm(), first);
  Rejudge(first, Changed(Arm(), 78));
  Start();
  EXPECT_EQ(Arm()->config.budgets.submission_files, 78);
  Start(77);
  EXPECT_EQ(Arm()->config.budgets.submission_files, 78) << "the file follows the first one";
}

TEST_F(BoardConfigsTest, AChangedFileIsWrittenDownIfItsBoardHadSubmissions) {
  Start(88);
  EXPECT_THAT(Rows(), IsEmpty());
  Submit(Arm());
  Start(99);
  ASSERT_THAT(Rows(), SizeIs(1));
  EXPECT_EQ(Rows().front().config, Arm()->config.hash);
}

TEST_F(BoardConfigsTest, PhasesHaveBoardsOfTheirOwn) {
  const TrackPtr to = Changed(Final(), 77);
  const std::string arm = Arm()->config.hash;
  Submit(Final());
  Rejudge(Final(), to);
  Start();
  EXPECT_EQ(Final()->config.hash, to->config.hash);
  EXPECT_EQ(Arm()->config.hash, arm);
  Start(0, /*with_phase=*/false);
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.Board().ConfigOfPhase(kFinal), to->config.hash);
  });
  EXPECT_TRUE(SwitchConfig(to, *tracks_, *phases_).ok()) << "nobody plays it any more";
}

TEST_F(BoardConfigsTest, APhaseWhoseConfigCantBeReadTakesNothing) {
  Rejudge(Final(), Changed(Final(), 77));
  Write([&](Transaction& writer) {
    return writer
        .journal.SetBoardConfig({{kFinal, kArm, kProfile}, Sha256Hex("{}"), "{}", 1}, "uid 0")
        .status();
  });
  Start();
  EXPECT_FALSE(phases_->Find(kFinal).ok());
  EXPECT_THAT(phases_->unusable(), SizeIs(1));
}

TEST_F(BoardConfigsTest, ARunningDaemonTakesAnotherConfig) {
  const TrackPtr before = Arm();
  const TrackPtr to = Changed(before, 77);
  ASSERT_TRUE(SwitchConfig(to, *tracks_, *phases_).ok());
  EXPECT_EQ(Arm()->config.hash, to->config.hash);
  EXPECT_EQ(Arm()->config.practice_seeds, before->config.practice_seeds);
  EXPECT_NE(before->config.hash, to->config.hash) << "who plays the old one goes on with it";
  ASSERT_TRUE(SwitchConfig(Changed(Final(), 78), *tracks_, *phases_).ok());
  EXPECT_EQ(Final()->config.budgets.submission_files, 78);
  EXPECT_FALSE(tracks_->Replace(Final()).ok()) << "a phase's config is not its track's";
  EXPECT_FALSE(phases_->Replace(Arm()).ok());
}

TEST_F(BoardConfigsTest, SeedsThatARejudgeRanksAreNotPractisedOn) {
  nlohmann::json effective = Arm()->config.effective;
  effective["seeds"] = {{"first", 100}, {"count", 100}};
  const std::vector<uint64_t> before = Arm()->config.practice_seeds;
  ASSERT_EQ(before.front(), 100u);
  ASSERT_TRUE(tracks_->Replace(*MakeTrack(*ParseTrackConfig(effective, "test"))).ok());
  EXPECT_EQ(tracks_->RankedBy(*Arm()->config.kind, 150), kArm);
  for (const uint64_t seed : Arm()->config.practice_seeds) EXPECT_GE(seed, 200u);
}

TEST_F(BoardConfigsTest, PhasesThatTheirStoreContradictsAreFound) {
  const auto hidden = [](const std::string& challenge) {
    return ChallengeOf({PhaseJson("hidden", {{"seeds", {{"committed", 10}}},
                                             {"opens_at", "2026-12-01T00:00:00Z"},
                                             {"closes_at", "2026-12-31T00:00:00Z"}})},
                       challenge);
  };
  const auto found = [&](const ChallengeConfig& challenge) {
    std::string text;
    Read([&](const Transaction& reader) {
      const auto mistakes = CheckAgainstStore({&challenge, 1}, reader, At("2026-12-10T00:00:00Z"));
      ASSERT_TRUE(mistakes.ok()) << mistakes.status();
      for (const std::string& mistake : *mistakes) text += mistake;
    });
    return text;
  };
  EXPECT_EQ(found(hidden("cup")), "") << "its secret is drawn when a daemon loads it";
  Write([](Transaction& writer) { return writer.phases.EnsureSecret("hidden", "cup").status(); });
  EXPECT_EQ(found(hidden("cup")), "");
  EXPECT_THAT(found(hidden("other")), HasSubstr("cup"));
  EXPECT_THAT(found(ChallengeOf({PhaseJson("hidden", {{"seeds", {500, 600}}})})),
              HasSubstr("has committed to hidden seeds"));
  Write([](Transaction& writer) {
    return writer.phases.AddEvent("hidden", kRevealedEvent, "organiser", "it is over").status();
  });
  EXPECT_THAT(found(hidden("cup")), HasSubstr("were revealed"));
}

}  // namespace
}  // namespace myograde::server
