// What a node keeps and shares: slots, unpacked submissions, and how it reads sstat's answer.
#include <unistd.h>

#include <filesystem>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "server/executor/slurm/node_state.h"
#include "server/executor/slurm/srun.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

TEST(Energy, OfSstatsAnswers) {
  EXPECT_EQ(ParseEnergy("1500\n"), 1500);
  EXPECT_EQ(ParseEnergy("1500|\n20|\n"), 1520);
  for (const char* answer : {"", "0\n", "\n", "18446744073709551614\n", "-1\n", "nan\n", "error"}) {
    EXPECT_FALSE(ParseEnergy(answer).has_value()) << answer;
  }
}

TEST(Slots, AreHeldByOneEach) {
  const TestFolder temp;
  const int64_t uid_base = geteuid() == 0 ? 700'000'000 : -1;
  auto first = NodeSlot::Take(temp.path(), uid_base);
  ASSERT_TRUE(first.ok()) << first.status();
  auto second = NodeSlot::Take(temp.path(), uid_base);
  ASSERT_TRUE(second.ok()) << second.status();
  LeaseOrder order;
  ASSERT_EQ(first->Prepare(order), absl::OkStatus());
  EXPECT_EQ(order.slot, 0);
  ASSERT_EQ(second->Prepare(order), absl::OkStatus());
  EXPECT_EQ(order.slot, 1);
  EXPECT_EQ(order.uid, uid_base < 0 ? -1 : uid_base + 1);
  EXPECT_TRUE(fs::is_empty(order.work_dir));
  second->CleanUp();
  EXPECT_FALSE(fs::exists(order.work_dir));
  first = absl::UnavailableError("released");
  EXPECT_EQ(NodeSlot::Take(temp.path(), uid_base)->Prepare(order), absl::OkStatus());
  EXPECT_EQ(order.slot, 0);
  if (geteuid() == 0) {
    EXPECT_TRUE(absl::IsInvalidArgument(NodeSlot::Take(temp.path(), -1).status()));
  }
}

class NodeArtefactsTest : public testing::Test {
 protected:
  // The digest of a submission with `content`, whose tar is sent from now on.
  std::string Make(const std::string& content) {
    const std::string folder = temp_ / "submission";
    fs::remove_all(folder);
    WriteFile(temp_ / "upload",
              TarEntry('0', "policy.json", R"({"name": "a", "command": ["./run"]})") +
                  TarEntry('0', "run", content, {}, 0755) + std::string(1024, '\0'))
        .IgnoreError();
    const Artefact artefact = *UnpackArtefact(temp_ / "upload", folder, {});
    tar_.clear();
    const auto add = [&](std::string_view bytes) {
      tar_ += bytes;
      return absl::OkStatus();
    };
    EXPECT_EQ(StreamArtefact(folder, artefact.digest, add), absl::OkStatus());
    return artefact.digest;
  }
  absl::StatusOr<HeldArtefact> Hold(const std::string& digest, int64_t most_bytes = 1 << 20) {
    bool sent = false;
    const auto source = [&, this]() -> absl::StatusOr<std::string> {
      if (sent) return "";
      sent = true;
      ++fetched_;
      return tar_;
    };
    return HoldArtefact(temp_.path(), digest, source, most_bytes);
  }

  const TestFolder temp_;
  std::string tar_;
  int fetched_ = 0;
};

TEST_F(NodeArtefactsTest, EachIsFetchedOnce) {
  const std::string digest = Make("#!/bin/sh\n");
  for (int i = 0; i < 2; ++i) {
    const auto held = Hold(digest);
    ASSERT_TRUE(held.ok()) << held.status();
    EXPECT_EQ(*ReadFile(held->folder + "/run"), "#!/bin/sh\n");
    // Others may hold it at the same time.
    EXPECT_TRUE(Hold(digest).ok());
  }
  EXPECT_EQ(fetched_, 1);
}

TEST_F(NodeArtefactsTest, OneThatArrivesDamagedIsNotKept) {
  const std::string digest = Make("#!/bin/sh\n");
  const std::string whole = tar_;
  tar_.resize(tar_.size() / 2);
  EXPECT_TRUE(absl::IsDataLoss(Hold(digest).status()));
  tar_ = whole;
  EXPECT_TRUE(Hold(digest).ok());
  EXPECT_EQ(fetched_, 2);
}

TEST_F(NodeArtefactsTest, WhatNobodyPlaysMakesRoom) {
  const std::string folder = Hold(Make(std::string(1000, '1')), 100)->folder;
  const auto held = Hold(Make(std::string(1000, '2')), 100);
  ASSERT_TRUE(held.ok()) << held.status();
  EXPECT_FALSE(fs::exists(folder));
  // One that is played stays.
  ASSERT_TRUE(Hold(Make(std::string(1000, '3')), 100).ok());
  EXPECT_TRUE(fs::exists(held->folder));
}

}  // namespace
}  // namespace myograde::server
