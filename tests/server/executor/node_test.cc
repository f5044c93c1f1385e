// What a node keeps and shares: slots, unpacked submissions, and how it reads others' answers.
#include <fcntl.h>
#include <unistd.h>

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "server/executor/node/energy.h"
#include "server/executor/node/folder_channel.h"
#include "server/executor/node/node_artefacts.h"
#include "server/executor/node/node_slot.h"
#include "server/executor/node/proof.h"
#include "server/executor/spool/artefact_tar.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST(Energy, OfSstatsAnswers) {
  EXPECT_EQ(ParseEnergy("1500\n"), 1500);
  EXPECT_EQ(ParseEnergy("1500|\n20|\n"), 1520);
  for (const char* answer : {"", "0\n", "\n", "18446744073709551614\n", "-1\n", "nan\n", "error"}) {
    EXPECT_FALSE(ParseEnergy(answer).has_value()) << answer;
  }
}

TEST(Proof, SaysWhatDiffers) {
  NodeProof proof;
  proof.grader = R"({"models":{},"simulator":"a"})";
  EXPECT_EQ(WhyNotEqual(proof, proof.grader), "");
  EXPECT_THAT(WhyNotEqual(proof, R"({"models":{},"simulator":"b"})"), HasSubstr("simulator;"));
  EXPECT_THAT(WhyNotEqual(proof, R"({"adapters":{},"models":{},"simulator":"a"})"),
              HasSubstr("adapters;"));
  proof.reference = "elsewhere";
  EXPECT_EQ(WhyNotEqual(proof, proof.grader), "elsewhere");
  proof.doctor = {"bubblewrap: not there"};
  EXPECT_THAT(WhyNotEqual(proof, proof.grader), HasSubstr("bubblewrap: not there"));
}

TEST(Slots, AreHeldByOneEach) {
  const TestFolder temp;
  const int64_t uid_base = geteuid() == 0 ? 700'000'000 : -1;
  auto first = NodeSlot::Take(temp.path(), uid_base);
  ASSERT_TRUE(first.ok()) << first.status();
  auto second = NodeSlot::Take(temp.path(), uid_base);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(first->number(), 0);
  EXPECT_EQ(second->number(), 1);
  LeaseOrder order;
  ASSERT_EQ(second->Prepare(order), absl::OkStatus());
  EXPECT_EQ(order.slot, 1);
  EXPECT_EQ(order.uid, uid_base < 0 ? -1 : uid_base + 1);
  EXPECT_TRUE(fs::is_empty(order.work_dir));
  second->CleanUp();
  EXPECT_FALSE(fs::exists(order.work_dir));
  first = absl::UnavailableError("released");
  EXPECT_EQ(NodeSlot::Take(temp.path(), uid_base)->number(), 0);
  if (geteuid() == 0) {
    EXPECT_TRUE(absl::IsInvalidArgument(NodeSlot::Take(temp.path(), -1).status()));
  }
}

class NodeArtefactsTest : public testing::Test {
 protected:
  // A packed submission with `content`.
  NodeArtefact Make(const std::string& content) {
    const fs::path folder = temp_.path() / Sha256Hex(content);
    fs::remove_all(folder);
    WriteFile(temp_ / "upload",
              TarEntry('0', "policy.json", R"({"name": "a", "command": ["./run"]})") +
                  TarEntry('0', "run", content, {}, 0755) + std::string(1024, '\0'))
        .IgnoreError();
    const Artefact artefact = *UnpackArtefact(temp_ / "upload", folder.string(), {});
    archive_ = folder.string() + ".tar";
    const Fd file(open(archive_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
    const PackedFolder packed = *PackArtefactFolder(folder.string(), artefact.digest, file.get());
    return {artefact.digest, packed.sha256, packed.bytes};
  }
  absl::Status Fetch(int file) {
    ++fetched_;
    return WriteAll(file, *ReadFile(archive_));
  }
  absl::StatusOr<HeldArtefact> Hold(const NodeArtefacts& artefacts, const NodeArtefact& artefact) {
    return artefacts.Hold(artefact, [this](const NodeArtefact&, int file) { return Fetch(file); });
  }

  const TestFolder temp_;
  std::string archive_;
  int fetched_ = 0;
};

TEST_F(NodeArtefactsTest, EachIsFetchedOnce) {
  const NodeArtefacts artefacts(temp_.path());
  const NodeArtefact artefact = Make("#!/bin/sh\n");
  for (int i = 0; i < 2; ++i) {
    const auto held = Hold(artefacts, artefact);
    ASSERT_TRUE(held.ok()) << held.status();
    EXPECT_EQ(*ReadFile(held->folder() + "/run"), "#!/bin/sh\n");
    // Others may hold it at the same time.
    EXPECT_TRUE(Hold(artefacts, artefact).ok());
  }
  EXPECT_EQ(fetched_, 1);
}

TEST_F(NodeArtefactsTest, OneThatArrivesDamagedIsNotKept) {
  const NodeArtefacts artefacts(temp_.path());
  NodeArtefact artefact = Make("#!/bin/sh\n");
  artefact.archive_bytes += 1;
  EXPECT_TRUE(absl::IsDataLoss(Hold(artefacts, artefact).status()));
  artefact.archive_bytes -= 1;
  EXPECT_TRUE(Hold(artefacts, artefact).ok());
  EXPECT_EQ(fetched_, 2);
}

TEST_F(NodeArtefactsTest, WhatNobodyPlaysMakesRoom) {
  const NodeArtefacts artefacts(temp_.path(), /*most_bytes=*/100);
  const NodeArtefact first = Make(std::string(1000, '1'));
  const std::string folder = Hold(artefacts, first)->folder();
  const NodeArtefact second = Make(std::string(1000, '2'));
  const auto held = Hold(artefacts, second);
  ASSERT_TRUE(held.ok()) << held.status();
  EXPECT_FALSE(fs::exists(folder));
  // One that is played stays.
  ASSERT_TRUE(Hold(artefacts, Make(std::string(1000, '3'))).ok());
  EXPECT_TRUE(fs::exists(held->folder()));
}

TEST(FolderChannel, AnEpochThatIsMissingForAMomentEndsNothing) {
  const TestFolder temp;
  const Spool spool = *Spool::Make(temp / "spool");
  const NodeOrder order = SomeNodeOrder();
  const LeaseFolder folder = *spool.MakeLease(order.name);
  ManualClock clock;
  FolderChannel channel(temp / "spool", order.name, clock);
  EXPECT_TRUE(absl::IsNotFound(channel.Order().status()));
  ASSERT_EQ(folder.PutOrder(order), absl::OkStatus());
  ASSERT_TRUE(channel.Order().ok());
  EXPECT_EQ(channel.AddRecords(0, "a\n"), absl::OkStatus());
  clock.Advance(absl::Seconds(50));
  EXPECT_EQ(channel.AddRecords(2, ""), absl::OkStatus());
  ASSERT_EQ(spool.PutEpoch(order.epoch), absl::OkStatus());
  EXPECT_EQ(channel.AddRecords(2, ""), absl::OkStatus());
  fs::remove(temp / "spool/epoch");
  EXPECT_EQ(channel.AddRecords(2, ""), absl::OkStatus());
  clock.Advance(FolderChannel::kEpochMissing);
  EXPECT_TRUE(absl::IsCancelled(channel.AddRecords(2, "")));
  ASSERT_EQ(spool.PutEpoch("another"), absl::OkStatus());
  EXPECT_TRUE(absl::IsCancelled(channel.AddRecords(2, "")));
  // Its end may be told as long as the folder is there.
  NodeEnd end;
  end.records_sha256 = std::string(64, '0');
  EXPECT_EQ(channel.PutEnd(end), absl::OkStatus());
  ASSERT_EQ(spool.RemoveLease(order.name), absl::OkStatus());
  EXPECT_TRUE(absl::IsCancelled(channel.PutEnd(end)));
}

}  // namespace
}  // namespace myograde::server
