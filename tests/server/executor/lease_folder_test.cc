// The folder between the daemon and its nodes: what is written is read again, nothing is followed,
// and a folder that is gone is noticed.
#include "server/executor/spool/lease_folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kName[] = "12-1-0123456789abcdef";
const std::string kLog = std::string(64, '1') + ".lcmlog.zst";

class LeaseFolderTest : public testing::Test {
 protected:
  LeaseFolderTest() : path_((folder_.path() / "spool").string()) {
    auto spool = Spool::Make(path_);
    EXPECT_TRUE(spool.ok()) << spool.status();
    spool_.emplace(*std::move(spool));
    auto lease = spool_->MakeLease(kName);
    EXPECT_TRUE(lease.ok()) << lease.status();
    lease_.emplace(*std::move(lease));
  }

  // A node's view of the same lease.
  LeaseFolder Node() const {
    auto spool = Spool::Open(path_);
    EXPECT_TRUE(spool.ok()) << spool.status();
    auto lease = spool->OpenLease(kName);
    EXPECT_TRUE(lease.ok()) << lease.status();
    return *std::move(lease);
  }

  Fd Source(const std::string& text) const {
    const std::string path = (folder_.path() / "source").string();
    EXPECT_TRUE(WriteFile(path, text).ok());
    return Fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  }

  static NodeClaim ClaimOf(const std::string& nonce) { return {"n1", "7_1", 0, nonce}; }

  TestFolder folder_;
  std::string path_;
  std::optional<Spool> spool_;
  std::optional<LeaseFolder> lease_;
};

TEST_F(LeaseFolderTest, ALeaseGoesToANodeAndBack) {
  const LeaseFolder node = Node();
  EXPECT_TRUE(absl::IsNotFound(node.Order().status()));
  ASSERT_EQ(lease_->PutOrder(SomeNodeOrder()), absl::OkStatus());
  ASSERT_TRUE(node.Order().ok()) << node.Order().status();
  EXPECT_EQ(node.Order()->name, kName);

  EXPECT_TRUE(absl::IsNotFound(lease_->Claim().status()));
  ASSERT_EQ(node.PutClaim(ClaimOf("0123456789abcdef")), absl::OkStatus());
  EXPECT_EQ(lease_->Claim()->job, "7_1");
  NodeProof proof;
  proof.node = "n1";
  proof.version = "0.1.0";
  proof.grader = "{}";
  ASSERT_EQ(node.PutProof(proof), absl::OkStatus());
  EXPECT_EQ(lease_->Proof()->version, "0.1.0");

  EXPECT_EQ(*lease_->Records(0, 100), "");
  ASSERT_EQ(node.WriteRecords(0, "one\n"), absl::OkStatus());
  ASSERT_EQ(node.WriteRecords(4, "two\n"), absl::OkStatus());
  ASSERT_EQ(node.WriteRecords(4, "two\n"), absl::OkStatus());  // a second try changes nothing
  EXPECT_EQ(*lease_->Records(0, 100), "one\ntwo\n");
  EXPECT_EQ(*lease_->Records(4, 2), "tw");
  EXPECT_EQ(*lease_->Records(8, 100), "");
  EXPECT_EQ(*lease_->RecordsSize(), 8);

  ASSERT_EQ(node.PutLog(kLog, BytesOf(Source("a log").get()), 100), absl::OkStatus());
  auto log = lease_->OpenLog(kLog);
  ASSERT_TRUE(log.ok()) << log.status();
  EXPECT_EQ(*ReadAll(log->get(), "log"), "a log");

  NodeEnd end;
  end.records_sha256 = std::string(64, 'e');
  end.why = "preempted";
  ASSERT_EQ(node.PutEnd(end), absl::OkStatus());
  EXPECT_EQ(lease_->End()->why, "preempted");
}

TEST_F(LeaseFolderTest, NothingIsLeftOfDraftsAndAllIsPrivate) {
  ASSERT_EQ(lease_->PutOrder(SomeNodeOrder()), absl::OkStatus());
  ASSERT_EQ(lease_->PutClaim(ClaimOf("0123456789abcdef")), absl::OkStatus());
  ASSERT_EQ(lease_->WriteRecords(0, "x"), absl::OkStatus());
  ASSERT_EQ(lease_->PutLog(kLog, BytesOf(Source("a log").get()), 100), absl::OkStatus());
  EXPECT_FALSE(lease_->PutLog(kLog, BytesOf(Source("too long").get()), 3).ok());
  EXPECT_FALSE(lease_->PutClaim(ClaimOf("fedcba9876543210")).ok());
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(path_)) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".draft")) << entry.path();
    struct stat info;
    ASSERT_EQ(stat(entry.path().c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 077, 0u) << entry.path();
    files += entry.is_regular_file();
  }
  EXPECT_EQ(files, 4);
}

TEST_F(LeaseFolderTest, OfManyClaimsOneIsTaken) {
  std::vector<std::thread> threads;
  std::vector<absl::Status> answers(8);
  for (size_t i = 0; i < answers.size(); ++i) {
    threads.emplace_back([&, i] {
      answers[i] = Node().PutClaim(ClaimOf("000000000000000" + std::to_string(i)));
    });
  }
  for (std::thread& thread : threads) thread.join();
  int taken = 0;
  for (size_t i = 0; i < answers.size(); ++i) {
    if (answers[i].ok()) {
      ++taken;
      EXPECT_EQ(lease_->Claim()->nonce, "000000000000000" + std::to_string(i));
      // Its answer may have been lost.
      EXPECT_EQ(lease_->PutClaim(*lease_->Claim()), absl::OkStatus());
    } else {
      EXPECT_TRUE(absl::IsAlreadyExists(answers[i])) << answers[i];
    }
  }
  EXPECT_EQ(taken, 1);
}

TEST_F(LeaseFolderTest, ANodeNoticesThatItsFolderIsGone) {
  const LeaseFolder node = Node();
  EXPECT_TRUE(*node.IsThere());
  EXPECT_FALSE(*node.stopped());
  ASSERT_EQ(lease_->Stop(), absl::OkStatus());
  EXPECT_TRUE(*node.stopped());
  ASSERT_EQ(spool_->RemoveLease(kName), absl::OkStatus());
  EXPECT_FALSE(*node.IsThere());
  EXPECT_FALSE(node.WriteRecords(0, "x").ok());
  // Another folder of that name is not the one that it claimed.
  ASSERT_TRUE(spool_->MakeLease(kName).ok());
  EXPECT_FALSE(*node.IsThere());
  EXPECT_TRUE(absl::IsAlreadyExists(spool_->MakeLease(kName).status()));
}

TEST_F(LeaseFolderTest, LinksAndOtherThingsAreNotFollowed) {
  const fs::path secret = folder_.path() / "secret";
  ASSERT_TRUE(WriteFile(secret.string(), "secret").ok());
  const fs::path lease = fs::path(path_) / "leases" / kName;
  fs::create_symlink(secret, lease / "records");
  fs::create_symlink(secret, lease / "claim");
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->Records(0, 10).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->WriteRecords(0, "x")));
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->Claim().status()));
  EXPECT_TRUE(absl::IsAlreadyExists(lease_->PutClaim(ClaimOf("0123456789abcdef"))));
  ASSERT_EQ(mkfifo((lease / "end.json").c_str(), 0600), 0);
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->End().status()));
  fs::create_directory(folder_.path() / "elsewhere");
  fs::create_directory_symlink(folder_.path() / "elsewhere", lease / "logs");
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->OpenLog(kLog).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->PutLog(kLog, BytesOf(Source("x").get()), 10)));
  EXPECT_TRUE(fs::is_empty(folder_.path() / "elsewhere"));
  // Nor when it is removed.
  ASSERT_EQ(spool_->RemoveLeases(), absl::OkStatus());
  EXPECT_EQ(*ReadFile(secret.string()), "secret");
  EXPECT_TRUE(fs::exists(folder_.path() / "elsewhere"));
  EXPECT_TRUE(spool_->Leases()->empty());
}

TEST_F(LeaseFolderTest, WhatIsTooLargeIsRefused) {
  const fs::path lease = fs::path(path_) / "leases" / kName;
  ASSERT_TRUE(WriteFile((lease / "claim").string(), std::string(kMostFormBytes + 1, ' ')).ok());
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->Claim().status()));
  EXPECT_TRUE(absl::IsResourceExhausted(lease_->WriteRecords(kMostRecordBytes, "x")));
  ASSERT_TRUE(WriteFile((lease / "records").string(), "").ok());
  ASSERT_EQ(truncate((lease / "records").c_str(), kMostRecordBytes + 1), 0);
  EXPECT_TRUE(absl::IsInvalidArgument(lease_->Records(0, 10).status()));
}

TEST_F(LeaseFolderTest, NamesThatLeadElsewhereAreRefused) {
  for (const char* name : {"..", "a/b", ""}) {
    EXPECT_TRUE(absl::IsInvalidArgument(spool_->OpenLease(name).status()));
    EXPECT_TRUE(absl::IsInvalidArgument(spool_->MakeLease(name).status()));
    EXPECT_TRUE(absl::IsInvalidArgument(spool_->RemoveLease(name)));
    EXPECT_TRUE(absl::IsInvalidArgument(spool_->OpenArtefact(name).status()));
    EXPECT_TRUE(absl::IsInvalidArgument(lease_->OpenLog(name).status()));
  }
}

TEST_F(LeaseFolderTest, EpochAndArtefactsAreKept) {
  EXPECT_TRUE(absl::IsNotFound(spool_->Epoch().status()));
  ASSERT_EQ(spool_->PutEpoch("first"), absl::OkStatus());
  ASSERT_EQ(spool_->PutEpoch("second"), absl::OkStatus());
  EXPECT_EQ(*spool_->Epoch(), "second");

  const std::string digest(64, 'a');
  EXPECT_FALSE(*spool_->HasArtefact(digest));
  ASSERT_EQ(spool_->PutArtefact(digest, BytesOf(Source("packed").get()), 100), absl::OkStatus());
  EXPECT_TRUE(*spool_->HasArtefact(digest));
  EXPECT_EQ(*ReadAll(spool_->OpenArtefact(digest)->get(), "archive"), "packed");
  EXPECT_EQ(*spool_->Artefacts(), std::vector<std::string>{digest});
  ASSERT_EQ(spool_->RemoveArtefact(digest), absl::OkStatus());
  EXPECT_FALSE(*spool_->HasArtefact(digest));
  EXPECT_EQ(spool_->Probe(), absl::OkStatus());
}

TEST_F(LeaseFolderTest, ASpoolThatIsNotThereIsNotMadeByANode) {
  EXPECT_TRUE(absl::IsNotFound(Spool::Open(path_ + "-none").status()));
  fs::create_directory_symlink(path_, path_ + "-link");
  EXPECT_TRUE(absl::IsInvalidArgument(Spool::Open(path_ + "-link").status()));
}

TEST_F(LeaseFolderTest, IsRefusedIfOthersMayWriteToIt) {
  for (const std::string part : {"", "/leases", "/artefacts"}) {
    for (const mode_t mode : {0777, 0720, 01702}) {
      ASSERT_EQ(chmod((path_ + part).c_str(), mode), 0);
      for (const absl::Status& status : {Spool::Make(path_).status(), Spool::Open(path_).status()}) {
        EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
        EXPECT_NE(status.message().find("chmod 700"), std::string::npos) << status;
      }
    }
    ASSERT_EQ(chmod((path_ + part).c_str(), 0750), 0);
  }
  EXPECT_TRUE(Spool::Open(path_).ok());
}

}  // namespace
}  // namespace myograde::server
