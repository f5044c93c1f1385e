// What nodes send by HTTPS: for the holder of one lease's token, into that lease's folder, once.
#include "server/executor/spool/spool_door.h"

#include <filesystem>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

constexpr char kFirst[] = "12-1-0123456789abcdef";
constexpr char kOther[] = "12-2-fedcba9876543210";

class SpoolDoorTest : public testing::Test {
 protected:
  SpoolDoorTest() : spool_(*Spool::Make(temp_ / "spool")), door_(spool_, 100) {
    lease_.emplace(*spool_.MakeLease(kFirst));
    EXPECT_TRUE(lease_->PutOrder(SomeNodeOrder()).ok());
    token_ = *door_.Open(kFirst, "");
  }
  RecordsState Add(int64_t offset, std::string_view bytes) {
    auto state = door_.AddRecords(kFirst, offset, bytes);
    EXPECT_TRUE(state.ok()) << state.status();
    return *state;
  }

  const TestFolder temp_;
  const Spool spool_;
  SpoolDoor door_;
  std::optional<LeaseFolder> lease_;
  std::string token_;
};

TEST_F(SpoolDoorTest, ATokenIsGoodForItsLeaseAloneAndEndsWithIt) {
  EXPECT_EQ(token_.size(), 64u);
  EXPECT_EQ(door_.Check(kFirst, token_), absl::OkStatus());
  EXPECT_TRUE(absl::IsPermissionDenied(door_.Check(kFirst, "")));
  EXPECT_TRUE(absl::IsPermissionDenied(door_.Check(kFirst, std::string(64, '0'))));
  EXPECT_TRUE(absl::IsNotFound(door_.Check(kOther, token_)));
  ASSERT_TRUE(spool_.MakeLease(kOther).ok());
  const std::string other = *door_.Open(kOther, "");
  EXPECT_TRUE(absl::IsPermissionDenied(door_.Check(kOther, token_)));
  EXPECT_NE(other, token_);
  door_.Close(kFirst);
  EXPECT_TRUE(absl::IsNotFound(door_.Check(kFirst, token_)));
  EXPECT_TRUE(absl::IsNotFound(door_.AddRecords(kFirst, 0, "x").status()));
  EXPECT_TRUE(absl::IsNotFound(door_.OrderText(kFirst).status()));
  EXPECT_EQ(door_.Check(kOther, other), absl::OkStatus());
}

TEST_F(SpoolDoorTest, RecordsAreAddedOnceInTheirOrder) {
  EXPECT_TRUE(Add(0, "").taken);
  EXPECT_EQ(Add(0, "one\n").size, 4);
  // The answer was lost: sent again, alone and with more.
  EXPECT_TRUE(Add(0, "one\n").taken);
  EXPECT_EQ(Add(0, "one\ntwo\n").size, 8);
  EXPECT_EQ(Add(2, "e\n").size, 8);
  EXPECT_EQ(*lease_->Records(0, 100), "one\ntwo\n");
  // A gap, another text, a negative place.
  for (const auto& [offset, bytes] : {std::pair<int64_t, const char*>(9, "x"), {4, "TWO\n"}, {-1, ""}}) {
    const RecordsState state = Add(offset, bytes);
    EXPECT_FALSE(state.taken);
    EXPECT_EQ(state.size, 8);
  }
  EXPECT_EQ(*lease_->Records(0, 100), "one\ntwo\n");
  EXPECT_FALSE(Add(8, "").stop);
  ASSERT_TRUE(lease_->Stop().ok());
  EXPECT_TRUE(Add(8, "").stop);
}

TEST_F(SpoolDoorTest, EverythingElseLandsInTheFolder) {
  EXPECT_EQ(*door_.OrderText(kFirst), NodeOrderToText(SomeNodeOrder()));
  const NodeClaim claim = {"n1", "7_1", 0, "0123456789abcdef"};
  EXPECT_EQ(door_.PutClaim(kFirst, claim), absl::OkStatus());
  EXPECT_EQ(door_.PutClaim(kFirst, claim), absl::OkStatus());
  EXPECT_TRUE(absl::IsAlreadyExists(
      door_.PutClaim(kFirst, {"n2", "7_1", 1, "fedcba9876543210"})));
  EXPECT_EQ(lease_->Claim()->node, "n1");
  NodeProof proof;
  proof.node = "n1";
  proof.version = "0.1.0";
  proof.grader = "{}";
  EXPECT_EQ(door_.PutProof(kFirst, proof), absl::OkStatus());
  EXPECT_TRUE(lease_->Proof().ok());
  NodeEnd end;
  end.records_sha256 = std::string(64, 'e');
  EXPECT_EQ(door_.PutEnd(kFirst, end), absl::OkStatus());
  EXPECT_TRUE(lease_->End().ok());

  const std::string log = std::string(64, '1') + ".lcmlog.zst";
  size_t left = 99;
  const ByteSource source = [&left](char* to, size_t size) {
    const size_t n = std::min({size, left, size_t{7}});
    std::fill_n(to, n, 'l');
    left -= n;
    return static_cast<ssize_t>(n);
  };
  EXPECT_EQ(door_.PutLog(kFirst, log, source), absl::OkStatus());
  EXPECT_EQ(ReadAll(lease_->OpenLog(log)->get(), log)->size(), 99u);
  left = 101;
  EXPECT_TRUE(absl::IsInvalidArgument(door_.PutLog(kFirst, log, source)));
  EXPECT_TRUE(absl::IsInvalidArgument(door_.PutLog(kFirst, "../log", source)));
}

TEST_F(SpoolDoorTest, TheArchiveIsThatOfTheOrder) {
  EXPECT_TRUE(absl::IsNotFound(door_.ArtefactPath(kFirst).status()));
  ASSERT_TRUE(spool_.MakeLease(kOther).ok());
  ASSERT_TRUE(door_.Open(kOther, std::string(64, 'a')).ok());
  EXPECT_EQ(*door_.ArtefactPath(kOther),
            temp_ / ("spool/artefacts/" + std::string(64, 'a') + ".tar"));
}

}  // namespace
}  // namespace myograde::server
