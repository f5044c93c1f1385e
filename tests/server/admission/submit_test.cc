// Submissions: which are accepted and as what, which are linked to an earlier one, which are
// rejected.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <filesystem>
#include <string>
#include <vector>

#include <absl/strings/str_replace.h>

#include "server/base/error_code.h"
#include "server/engine/stored.h"
#include "tests/server/admission/admission_world.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

class SubmitTest : public AdmissionWorld {
 protected:
  std::string CodeOf(const std::string& team, char artefact,
                     std::optional<int64_t> episodes = std::nullopt) {
    return ErrorCodeOf(Submit(team, artefact, episodes).status());
  }
  const TrackConfig& config() const { return (*tracks_->Find(kTrack, ""))->config; }
};

TEST_F(SubmitTest, AnAcceptedOneWaitsToBePlayed) {
  AddArtefact('a');
  const auto accepted = Submit("alpha", 'a');
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  EXPECT_FALSE(accepted->linked);
  EXPECT_EQ(accepted->blocks.size(), 3u);
  EXPECT_TRUE(engine_->EstimateOutlook(accepted->evaluation).place.has_value());
  const SubmissionRow row = FindSubmission(*accepted);
  EXPECT_EQ(row.team, "alpha");
  EXPECT_EQ(row.accepted_by, "uid 7");
  EXPECT_EQ(row.config, config().hash);
  EXPECT_TRUE(row.ranked);
  EXPECT_EQ(Count("upload"), 0) << "it was submitted";
}

TEST_F(SubmitTest, OnlyTheWholeSeedListIsRanked) {
  AddArtefact('a');
  SubmitRequest request{.artefact = std::string(64, 'a'),
                        .team = "alpha",
                        .track = kTrack,
                        .profile = "",
                        .seeds = std::nullopt,
                        .episodes = std::nullopt};
  const auto is_ranked = [&] {
    const auto accepted = admission().Submit(request, "uid 7");
    EXPECT_TRUE(accepted.ok()) << accepted.status();
    return FindSubmission(accepted.value_or(Accepted())).ranked;
  };
  EXPECT_TRUE(is_ranked());
  request.episodes = 2;
  EXPECT_FALSE(is_ranked());
  request.episodes = 3;
  EXPECT_FALSE(is_ranked()) << "as many as are ranked, and not those";
  request.episodes = std::nullopt;
  request.seeds = {171, 172, 173, 174, 175};
  EXPECT_FALSE(is_ranked());
}

TEST_F(SubmitTest, PracticePlaysNoSeedThatSomebodyRanks) {
  AddArtefact('a');
  SubmitRequest request{.artefact = std::string(64, 'a'),
                        .team = "alpha",
                        .track = kTrack,
                        .profile = "",
                        .seeds = config().seeds,
                        .episodes = std::nullopt};
  const auto refused = [&] { return admission().Submit(request, "uid 7").status(); };
  EXPECT_EQ(ErrorCodeOf(refused()), "ranked_seed");
  request.seeds = {171, config().seeds.back()};
  EXPECT_EQ(ErrorCodeOf(refused()), "ranked_seed");
  request.episodes = 1;
  EXPECT_EQ(ErrorCodeOf(refused()), "ranked_seed") << "what is in the list counts";
  request.episodes = std::nullopt;
  request.seeds = {171, 99};  // another track's, in the same environment
  EXPECT_EQ(ErrorCodeOf(refused()), "ranked_seed");
  EXPECT_THAT(std::string(refused().message()), HasSubstr("the seed 99, which track \"manipulation\""));
  EXPECT_EQ(Count("submission"), 0);
}

TEST_F(SubmitTest, MoreEpisodesThanSeedsAreRefused) {
  AddArtefact('a');
  const auto refused = Submit("alpha", 'a', 4);
  EXPECT_TRUE(absl::IsInvalidArgument(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "");
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("the track's list of practice seeds has 3"));
}

TEST_F(SubmitTest, TheSameArtefactAgainIsTheFirstSubmission) {
  AddArtefact('a');
  const auto first = Submit("alpha", 'a');
  ASSERT_TRUE(first.ok()) << first.status();
  const auto again = Submit("alpha", 'a');
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_EQ(again->submission, first->submission);
  EXPECT_EQ(again->evaluation, first->evaluation);
  EXPECT_EQ(Count("submission"), 1);
}

TEST_F(SubmitTest, AnotherTeamsArtefactIsRefusedWhereItCountsForEveryone) {
  options_.config.quota.defaults.one_for_everyone = true;
  AddArtefact('a');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  EXPECT_EQ(CodeOf("beta", 'a'), "same_artefact");
  const auto practice = Submit("beta", 'a', 2);
  EXPECT_TRUE(practice.ok()) << practice.status();
}

TEST_F(SubmitTest, AnotherTeamsArtefactIsTakenWhereItCountsForEachTeam) {
  AddArtefact('a');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  const auto other = Submit("beta", 'a');
  ASSERT_TRUE(other.ok()) << other.status();
  EXPECT_FALSE(other->linked);
}

// Whoever knows the hash of another team's policy must not be able to submit, practise or block with it.
TEST_F(SubmitTest, AnotherTeamsArtefactIsLikeOneThatThereIsNot) {
  options_.config.quota.defaults.one_for_everyone = true;
  AddArtefact('a');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  SubmitRequest request{.artefact = std::string(64, 'a'),
                        .team = "beta",
                        .track = kTrack,
                        .profile = "",
                        .seeds = std::nullopt,
                        .episodes = std::nullopt};
  const auto as_beta = [&](char artefact) {
    request.artefact = std::string(64, artefact);
    std::string message(admission().Submit(request, "uid 8").status().message());
    return absl::StrReplaceAll(message, {{request.artefact, "HASH"}});
  };
  for (const std::optional<int64_t> episodes : {std::optional<int64_t>(), std::optional<int64_t>(2)}) {
    request.episodes = episodes;
    EXPECT_EQ(as_beta('a'), "there is no artefact HASH; upload it first");
    EXPECT_EQ(as_beta('a'), as_beta('f'));
    std::filesystem::remove_all(ArtefactPath(std::string(64, 'a')));
    EXPECT_EQ(as_beta('a'), as_beta('f')) << "nor whether its files are here";
    std::filesystem::create_directory(ArtefactPath(std::string(64, 'a')));
  }
  EXPECT_EQ(Count("submission"), 1);
  // The team that submitted it may, whoever acts for it, and so may an organiser.
  request.team = "alpha";
  request.artefact = std::string(64, 'a');
  EXPECT_TRUE(admission().Submit(request, "uid 9").ok());
  request.team = "gamma";
  request.organiser = true;
  EXPECT_TRUE(admission().Submit(request, "uid 0").ok());
}

TEST_F(SubmitTest, WhoeverUploadsAnArtefactMaySubmitIt) {
  const auto submit = [&](const std::string& hash, const std::string& team, const std::string& who) {
    return admission().Submit({.artefact = hash, .team = team, .track = kTrack, .profile = "",
                               .seeds = std::nullopt, .episodes = 2}, who).status();
  };
  const auto upload = [&](const std::string& team, const std::string& who) {
    MemoryArchive archive(GoodTar());
    return admission().Receive({.from = {who, team, false}, .track = team.empty() ? "" : kTrack},
                               archive);
  };
  const auto first = upload("alpha", "uid 7");
  ASSERT_TRUE(first.ok()) << first.status();
  const std::string hash = first->artefact.hash;
  EXPECT_TRUE(absl::IsNotFound(submit(hash, "beta", "uid 8")));
  EXPECT_TRUE(submit(hash, "alpha", "uid 9").ok()) << "it was uploaded for the team";
  EXPECT_TRUE(absl::IsNotFound(submit(hash, "beta", "uid 8"))) << "and was submitted by now";
  const auto again = upload("beta", "uid 8");
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_FALSE(again->is_new);
  EXPECT_TRUE(submit(hash, "beta", "uid 9").ok());
  EXPECT_TRUE(submit(hash, "gamma", "uid 8").ok()) << "whoever had the files may act for any team";
  EXPECT_TRUE(absl::IsNotFound(submit(hash, "delta", "uid 9")));
  const int64_t holders = Count("artefact_holder");
  ASSERT_TRUE(upload("beta", "uid 8").ok());
  EXPECT_EQ(Count("artefact_holder"), holders) << "once";
}

TEST_F(SubmitTest, AUsedUpQuotaIsOneTeamsAndOneBudgets) {
  options_.config.quota.defaults.quota.ranked = {1, 1};
  AddArtefact('a');
  AddArtefact('b');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  EXPECT_EQ(CodeOf("alpha", 'b'), "quota");
  EXPECT_EQ(Count("submission"), 1);
  EXPECT_TRUE(Submit("alpha", 'b', 1).ok());
  EXPECT_TRUE(Submit("beta", 'b').ok());
}

TEST_F(SubmitTest, ATracksOwnQuotaCountsThere) {
  QuotaConfig& quota = options_.config.quota;
  quota.tracks[kTrack] = quota.defaults;
  quota.tracks[kTrack].quota.waiting = 1;
  AddArtefact('a');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  EXPECT_EQ(CodeOf("alpha", 'a', 1), "quota");
}

TEST_F(SubmitTest, UsedUpFailedTriesForbidSubmissionsToo) {
  options_.config.quota.defaults.quota.failed = {1, 1};
  AddArtefact('a');
  EXPECT_EQ(ErrorCodeOf(Receive(std::string(), "alpha").status()), "bad_artefact");
  EXPECT_EQ(CodeOf("alpha", 'a'), "quota");
}

TEST_F(SubmitTest, AHostThatFailsItsReferenceGradesPracticeAlone) {
  std::optional<std::string> verdict = "this host computes otherwise";
  absl::Duration waited;
  options_.reference = [&](std::string_view kind, absl::Duration timeout) {
    EXPECT_FALSE(kind.empty());
    waited = timeout;
    return verdict;
  };
  AddArtefact('a');
  const auto refused = Submit("alpha", 'a');
  EXPECT_TRUE(absl::IsUnavailable(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "not_official");
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("this host computes otherwise"));
  EXPECT_EQ(Count("submission"), 0);
  EXPECT_LT(waited, options_.config.http.request);

  verdict = std::nullopt;
  const auto early = Submit("alpha", 'a');
  EXPECT_EQ(ErrorCodeOf(early.status()), "not_official");
  EXPECT_THAT(std::string(early.status().message()), HasSubstr("still being played"));

  waited = absl::ZeroDuration();
  EXPECT_TRUE(Submit("alpha", 'a', 2).ok());
  EXPECT_EQ(waited, absl::ZeroDuration()) << "practice waits for no verdict";

  verdict = "";
  EXPECT_TRUE(Submit("alpha", 'a').ok());
}

TEST_F(SubmitTest, ATeamThatLooksLikeAnotherIsRefused) {
  AddArtefact('a');
  ASSERT_TRUE(Submit("alpha", 'a').ok());
  const auto refused = Submit(kCyrillicAlpha, 'a');
  EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "look_alike");
  EXPECT_EQ(ResembledTeam(refused.status()), "alpha");
  EXPECT_EQ(Count("team"), 1);
}

TEST_F(SubmitTest, ANameThatNoTeamMayHaveIsRefused) {
  AddArtefact('a');
  const auto refused = Submit("alpha\xe3\x85\xa4", 'a');
  EXPECT_TRUE(absl::IsInvalidArgument(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "");
  EXPECT_EQ(Count("team"), 0);
}

TEST_F(SubmitTest, WhatThisServerLacksIsNamed) {
  options_.config.runtimes = {{"python", "/opt/python"}};
  AddArtefact('a');
  AddArtefact('b', 10, {"python"});
  AddArtefact('c', 10, {"python", "julia"});
  AddArtefact('d', config().budgets.submission_bytes + 1);
  SubmitRequest request{.artefact = std::string(64, 'a'),
                        .team = "alpha",
                        .track = "flying",
                        .profile = "",
                        .seeds = std::nullopt,
                        .episodes = std::nullopt};
  EXPECT_EQ(ErrorCodeOf(admission().Submit(request, "uid 7").status()), "unknown_track");
  request.track = kTrack;
  request.profile = "odd";
  EXPECT_EQ(ErrorCodeOf(admission().Submit(request, "uid 7").status()), "unknown_profile");
  EXPECT_EQ(CodeOf("alpha", 'c'), "unknown_runtime");
  EXPECT_EQ(CodeOf("alpha", 'd'), "bad_artefact");
  EXPECT_EQ(Count("submission"), 0);
  EXPECT_TRUE(Submit("alpha", 'b').ok());
}

TEST_F(SubmitTest, ExtraObservationsAreShownWhereTheProfileAllowsThem) {
  AddArtefact('a');
  AddArtefact('b', {{.name = "walker", .command = {"./policy"}, .extra_observations = true},
                    std::string(64, 'b'), 10, 2});
  EXPECT_EQ(CodeOf("alpha", 'b'), "bad_artefact") << "the profile is paper";
  EXPECT_EQ(Count("submission"), 0);
  SubmitRequest request{.artefact = std::string(64, 'b'),
                        .team = "alpha",
                        .track = kTrack,
                        .profile = "myosuite",
                        .seeds = std::nullopt,
                        .episodes = std::nullopt};
  const auto shown = admission().Submit(request, "uid 7");
  ASSERT_TRUE(shown.ok()) << shown.status();
  EXPECT_TRUE(FindSubmission(*shown).extra_observations);
  request.artefact = std::string(64, 'a');
  const auto plain = admission().Submit(request, "uid 7");
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_FALSE(FindSubmission(*plain).extra_observations) << "it did not ask";
  // An adapter takes what there is, and plays without.
  AddArtefact('c', {{.name = "veteran", .command = {"./policy"}, .adapter = "template-2024"},
                    std::string(64, 'c'), 10, 2});
  EXPECT_EQ(CodeOf("alpha", 'c'), "") << "the profile is paper";
  request.artefact = std::string(64, 'c');
  const auto adapted = admission().Submit(request, "uid 7");
  ASSERT_TRUE(adapted.ok()) << adapted.status();
  EXPECT_TRUE(FindSubmission(*adapted).extra_observations);
}

TEST_F(SubmitTest, AnArtefactMustBeHereWithItsFiles) {
  AddArtefact('a');
  fs::remove(ArtefactPath(std::string(64, 'a')));
  for (const char artefact : {'a', 'e'}) {
    const auto refused = Submit("alpha", artefact);
    EXPECT_TRUE(absl::IsNotFound(refused.status())) << refused.status();
    EXPECT_EQ(ErrorCodeOf(refused.status()), "");
  }
  EXPECT_EQ(Count("submission"), 0);
}

TEST_F(SubmitTest, ADamagedArtefactIsRefusedAndOthersAreNot) {
  AddArtefact('a');
  AddArtefact('b');
  DamageArtefact('a');
  EXPECT_EQ(CodeOf("alpha", 'a'), kDamagedRowCode);
  EXPECT_EQ(Count("submission"), 0);
  EXPECT_TRUE(Submit("alpha", 'b').ok());
}

TEST_F(SubmitTest, AStoreThatCantBeReadAcceptsNothing) {
  AddArtefact('a');
  fs::rename(dir_ + "/store.db", dir_ + "/away.db");
  const auto refused = Submit("alpha", 'a');
  EXPECT_TRUE(MayPass(refused.status())) << refused.status();
  fs::rename(dir_ + "/away.db", dir_ + "/store.db");
  EXPECT_EQ(Count("submission"), 0);
}

TEST_F(SubmitTest, AStoreThatCantBeWrittenAcceptsNothing) {
  AddArtefact('a');
  disk_->full = true;
  const auto refused = Submit("alpha", 'a');
  EXPECT_FALSE(refused.ok());
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("the disk is full"));
  EXPECT_EQ(Count("submission"), 0);
  EXPECT_EQ(Count("team"), 0);
}

TEST(SplitIntoBlocks, CutsAtMultiplesAndCoversEverything) {
  EXPECT_THAT(SplitIntoBlocks(25, 10), ElementsAre(Pair(0, 9), Pair(10, 19), Pair(20, 24)));
  EXPECT_THAT(SplitIntoBlocks(1, 10), ElementsAre(Pair(0, 0)));
  EXPECT_TRUE(rc::check([] {
    const auto count = *rc::gen::inRange<int64_t>(1, 500);
    const auto per_lease = *rc::gen::inRange<int64_t>(1, 100);
    int64_t next = 0;
    for (const auto& [first, last] : SplitIntoBlocks(count, per_lease)) {
      RC_ASSERT(first == next && first % per_lease == 0 && last >= first);
      RC_ASSERT(last - first < per_lease);
      next = last + 1;
    }
    RC_ASSERT(next == count);
  }));
}

}  // namespace
}  // namespace myograde::server
