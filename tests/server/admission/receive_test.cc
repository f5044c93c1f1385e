// Received archives: what is kept, what is rejected, and who is charged for a rejection.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "server/base/error_code.h"
#include "tests/server/admission/admission_world.h"

namespace myograde::server {
namespace {

// Where myograde-unpack is.
[[maybe_unused]] const int kBinDirSet = ::setenv("MYOGRADE_BIN_DIR", MYOGRADE_BIN_DIR, 1);

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using ReceiveTest = AdmissionWorld;

TEST_F(ReceiveTest, KeepsWhatIsInTheArchive) {
  const auto received = Receive(GoodTar(), "alpha");
  ASSERT_TRUE(received.ok()) << received.status();
  EXPECT_TRUE(received->is_new);
  EXPECT_EQ(received->artefact.name, "walker");
  EXPECT_THAT(received->artefact.command, ElementsAre("./policy"));
  EXPECT_TRUE(fs::exists(ArtefactPath(received->artefact.hash) + "/policy"));
  EXPECT_TRUE(IsEmpty("spool"));
  EXPECT_EQ(Count("artefact"), 1);
  EXPECT_EQ(Count("upload"), 1);
  EXPECT_EQ(Count("ledger"), 0);
}

TEST_F(ReceiveTest, TheSameBytesAreNotUnpackedAgain) {
  const auto first = Receive(GoodTar());
  ASSERT_TRUE(first.ok()) << first.status();
  MemoryArchive archive(GoodTar());
  const auto again = Receive(archive);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_FALSE(again->is_new);
  EXPECT_FALSE(archive.moved);
  EXPECT_EQ(again->artefact.hash, first->artefact.hash);
}

TEST_F(ReceiveTest, TheSameContentInOtherBytesIsTheSameArtefact) {
  const auto first = Receive(GoodTar());
  ASSERT_TRUE(first.ok()) << first.status();
  MemoryArchive archive(GoodTar() + std::string(kTarBlock, '\0'));
  const auto again = Receive(archive);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(archive.moved);
  EXPECT_FALSE(again->is_new);
  EXPECT_EQ(again->artefact.hash, first->artefact.hash);
  EXPECT_TRUE(IsEmpty("spool"));
}

TEST_F(ReceiveTest, FilesThatWereRemovedComeBack) {
  const auto first = Receive(GoodTar());
  ASSERT_TRUE(first.ok()) << first.status();
  const std::string folder = ArtefactPath(first->artefact.hash);
  fs::remove_all(folder);
  const auto again = Receive(GoodTar());
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(fs::exists(folder + "/policy"));
}

TEST_F(ReceiveTest, AnUploadForANewTeamFoundsIt) {
  const auto upload = [&](const std::string& person, const std::string& team) {
    MemoryArchive archive(GoodTar());
    return admission()
        .Receive({.from = {person, team, /*organiser=*/false},
                  .track = kTrack,
                  .founding = Founding{.person = person, .most = 1}},
                 archive)
        .status();
  };
  EXPECT_TRUE(upload("uid 7", "alpha").ok());
  EXPECT_EQ(Count("member"), 1);
  EXPECT_TRUE(upload("uid 7", "alpha").ok()) << "a member's team stays";
  const absl::Status stranger = upload("uid 8", "alpha");
  EXPECT_EQ(ErrorCodeOf(stranger), "forbidden") << stranger;
  EXPECT_THAT(stranger.message(), HasSubstr("belongs to others"));
  const absl::Status second = upload("uid 7", "beta");
  EXPECT_EQ(ErrorCodeOf(second), "forbidden") << second;
  EXPECT_THAT(second.message(), HasSubstr("one person may belong to 1 team"));
  EXPECT_EQ(Count("member"), 1);
  EXPECT_EQ(Count("team"), 1);
}

TEST_F(ReceiveTest, ARefusedArchiveIsAFailedTryOfItsTeam) {
  const std::pair<std::string, const char*> bad[] = {
      {"", "the archive is empty"},
      {"no archive at all", ""},
      {TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'), "policy.json"},
      {TarEntry('0', "../evil", "x") + GoodTar(), "\"..\" in its path"},
      {TarWith(R"({"name": "walker", "command": ["./policy"], "speed": 1})"), "speed"},
      {TarWith(R"({"name": "walker", "command": ["no-such-program"]})"), "no-such-program"},
      {TarWith(R"({"name": "a\u3164", "command": ["./policy"]})"), "U+3164"}};
  int64_t tries = 0;
  for (const auto& [bytes, why] : bad) {
    const auto refused = Receive(bytes, "alpha");
    EXPECT_TRUE(absl::IsInvalidArgument(refused.status())) << why << ": " << refused.status();
    EXPECT_EQ(ErrorCodeOf(refused.status()), "bad_artefact") << why;
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr(why));
    const std::vector<LedgerRow> ledger = LedgerOf("alpha");
    ASSERT_EQ(std::ssize(ledger), ++tries) << why;
    EXPECT_EQ(ledger.front().budget, EnumName(Budget::kFailed));
    EXPECT_EQ(ledger.front().who, "uid 7");
    EXPECT_EQ(ledger.front().why,
              absl::StrCat("upload refused: ", std::string(refused.status().message())));
  }
  EXPECT_EQ(Count("artefact"), 0);
  EXPECT_TRUE(IsEmpty("artefacts"));
  EXPECT_TRUE(IsEmpty("spool"));
}

TEST_F(ReceiveTest, AnAdapterThatCantPlayTheTrackIsRefusedWithItsUpload) {
  const std::string adapted =
      TarWith(R"({"name": "veteran", "command": ["./policy"], "adapter": "template-2024"})");
  const auto receive = [&](const std::string& track) {
    MemoryArchive archive(adapted);
    return admission().Receive({.from = {"uid 7", "alpha", false}, .track = track}, archive);
  };
  for (int round = 0; round < 2; ++round) {
    const auto refused = receive("elbow");
    EXPECT_EQ(ErrorCodeOf(refused.status()), "bad_artefact");
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr(
        "does not support tracks of the kind"));
    EXPECT_EQ(std::ssize(LedgerOf("alpha")), round + 1);
    EXPECT_EQ(Count("artefact"), round) << "known on another track by then";
    EXPECT_TRUE(IsEmpty("spool"));
    const auto taken = receive(kTrack);
    ASSERT_TRUE(taken.ok()) << taken.status();
    EXPECT_EQ(taken->artefact.adapter, "template-2024");
  }
}

TEST_F(ReceiveTest, WithoutATeamARefusalIsChargedToNobody) {
  const auto refused = Receive("no archive at all");
  EXPECT_EQ(ErrorCodeOf(refused.status()), "bad_artefact");
  EXPECT_EQ(Count("ledger"), 0);
  EXPECT_EQ(Count("team"), 0);
}

TEST_F(ReceiveTest, WhoHasUsedUpTheFailedTriesIsRefusedBeforeAnythingIsUnpacked) {
  options_.config.quota.defaults.quota.failed = {1, 1};
  EXPECT_EQ(ErrorCodeOf(Receive("no archive at all", "alpha").status()), "bad_artefact");
  MemoryArchive archive(GoodTar());
  const auto refused = Receive(archive, "alpha");
  EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "quota");
  EXPECT_FALSE(archive.moved);
  EXPECT_EQ(LedgerOf("alpha").size(), 1u);
  const auto other = Receive(archive, "beta");
  EXPECT_TRUE(other.ok()) << other.status();
}

// Its reads fail.
class UnreadableArchive : public MemoryArchive {
 public:
  using MemoryArchive::MemoryArchive;
  ssize_t ReadAt(char*, size_t, int64_t) const override { return -1; }
};

// The slowest possible archive: a pipe without a writer.
class EndlessArchive : public MemoryArchive {
 public:
  using MemoryArchive::MemoryArchive;
  absl::Status MoveTo(const std::string& path) override {
    return mkfifo(path.c_str(), 0600) == 0 ? absl::OkStatus() : absl::InternalError("no pipe");
  }
};

TEST_F(ReceiveTest, ABrokenUploadIsChargedToNobody) {
  UnreadableArchive archive(GoodTar());
  const auto refused = Receive(archive, "alpha");
  EXPECT_TRUE(absl::IsUnavailable(refused.status())) << refused.status();
  EXPECT_EQ(Count("ledger"), 0);
}

TEST_F(ReceiveTest, ABusyHostIsChargedToNobody) {
  options_.config.http.upload = absl::Milliseconds(300);
  EndlessArchive archive(GoodTar());
  const auto refused = Receive(archive, "alpha");
  EXPECT_TRUE(absl::IsUnavailable(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "busy");
  EXPECT_EQ(Count("ledger"), 0);
  EXPECT_TRUE(IsEmpty("spool"));
}

TEST_F(ReceiveTest, AFullDiskIsChargedToNobody) {
  options_.config.artefacts.disk_reserve = std::numeric_limits<int64_t>::max();
  EndlessArchive archive(GoodTar());
  const auto refused = Receive(archive, "alpha");
  EXPECT_TRUE(absl::IsResourceExhausted(refused.status())) << refused.status();
  EXPECT_EQ(Count("ledger"), 0);
  EXPECT_TRUE(IsEmpty("spool"));
}

TEST_F(ReceiveTest, GivesUpWhenItIsAskedTo) {
  for (const int after : {0, 3}) {  // while it is read, and while it is unpacked
    EndlessArchive archive(GoodTar());
    int asked = 0;
    const auto refused = admission().Receive({.from = {"uid 7", "alpha", false},
                                              .track = kTrack,
                                              .stopping = [&] { return asked++ >= after; }},
                                             archive);
    EXPECT_TRUE(absl::IsCancelled(refused.status())) << refused.status();
    EXPECT_EQ(Count("ledger"), 0);
    EXPECT_TRUE(IsEmpty("spool"));
  }
}

TEST_F(ReceiveTest, ATeamThatLooksLikeAnotherIsRefusedBeforeAnythingIsUnpacked) {
  EXPECT_EQ(ErrorCodeOf(Receive("no archive at all", "alpha").status()), "bad_artefact");
  MemoryArchive archive(GoodTar());
  const auto refused = Receive(archive, kCyrillicAlpha);
  EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "look_alike");
  EXPECT_EQ(ResembledTeam(refused.status()), "alpha");
  EXPECT_FALSE(archive.moved);
  EXPECT_EQ(Count("ledger"), 1);
}

TEST_F(ReceiveTest, ATrackThatIsNotOnOfferIsTold) {
  MemoryArchive archive(GoodTar());
  const auto refused =
      admission().Receive({.from = {"uid 7", "alpha", false}, .track = "flying"}, archive);
  EXPECT_TRUE(absl::IsNotFound(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "unknown_track");
  EXPECT_FALSE(archive.moved);
}

TEST_F(ReceiveTest, TooManyThatWereNeverSubmittedAreRefusedAndNotCharged) {
  options_.config.artefacts.unsubmitted.of_one = 1;
  ASSERT_TRUE(Receive(GoodTar(), "alpha").ok());
  const auto refused = Receive(GoodTar("runner"), "alpha");
  EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << refused.status();
  EXPECT_EQ(ErrorCodeOf(refused.status()), "quota");
  EXPECT_EQ(Count("artefact"), 1);
  EXPECT_EQ(Count("ledger"), 0);
  MemoryArchive archive(GoodTar("runner"));
  const auto organisers = admission().Receive(
      {.from = {"uid 0", "alpha", /*organiser=*/true}, .track = kTrack}, archive);
  EXPECT_TRUE(organisers.ok()) << organisers.status();
}

TEST_F(ReceiveTest, AStoreThatCantBeWrittenKeepsNothing) {
  disk_->full = true;
  const auto refused = Receive(GoodTar());
  EXPECT_FALSE(refused.ok());
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("the disk is full"));
  EXPECT_TRUE(IsEmpty("artefacts"));
  EXPECT_TRUE(IsEmpty("spool"));
  EXPECT_EQ(Count("artefact"), 0);
}

TEST_F(ReceiveTest, AStoreThatCantBeReadLetsNobodyIn) {
  fs::rename(dir_ + "/store.db", dir_ + "/away.db");
  MemoryArchive archive(GoodTar());
  const auto refused = Receive(archive, "alpha");
  EXPECT_TRUE(MayPass(refused.status())) << refused.status();
  EXPECT_FALSE(archive.moved);
  EXPECT_TRUE(MayPass(Receive(archive).status()));
  EXPECT_TRUE(IsEmpty("artefacts"));
  EXPECT_TRUE(IsEmpty("spool"));
  fs::rename(dir_ + "/away.db", dir_ + "/store.db");
  EXPECT_EQ(Count("ledger"), 0);
}

}  // namespace
}  // namespace myograde::server
