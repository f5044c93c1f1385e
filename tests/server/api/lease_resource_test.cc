// A node's channel by HTTP and the daemon's end of it: everything arrives in the spool, and no token
// but a lease's own opens anything of it.
#include "server/api/resources.h"

#include <fcntl.h>

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "server/api/guard.h"
#include "server/api/unix_http_server.h"
#include "server/executor/node/http_channel.h"
#include "server/executor/spool/lease_folder.h"
#include "server/executor/spool/spool_door.h"
#include "tests/server/api/gate_world.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

using testing::HasSubstr;

constexpr char kAttempt[] = "12-1-0123456789abcdef";
constexpr int64_t kMostLog = 100'000;

class LeaseResourceTest : public testing::Test {
 protected:
  LeaseResourceTest() {
    server_->SetAdmit([this](Connection& connection) {
      return guard_.AdmitBody(connection, server_->router());
    });
    AddLeases(routes_, &door_);
    ListenConfig listen;
    listen.address = "127.0.0.1";
    EXPECT_TRUE(server_->OpenNetwork(listen).ok());
    EXPECT_TRUE(server_->Start(temp_ / "socket").ok());
    lease_.emplace(*spool_.MakeLease(kAttempt));
    NodeOrder order = SomeNodeOrder();
    order.name = kAttempt;
    EXPECT_TRUE(lease_->PutOrder(order).ok());
    token_ = *door_.Open(kAttempt, order.artefact->digest);
  }
  ~LeaseResourceTest() override { server_->Shutdown(); }

  std::unique_ptr<HttpChannel> ChannelOf(const std::string& lease, const std::string& token) {
    auto channel = HttpChannel::Open({server_->NetworkUrl(), lease, token, ""});
    EXPECT_TRUE(channel.ok()) << channel.status();
    return *std::move(channel);
  }
  std::unique_ptr<HttpChannel> Node() { return ChannelOf(kAttempt, token_); }
  Fd File(const std::string& text) {
    EXPECT_TRUE(WriteFile(temp_ / "file", text).ok());
    return Fd(open((temp_ / "file").c_str(), O_RDWR | O_CLOEXEC));
  }

  const TestFolder temp_;
  const Spool spool_ = *Spool::Make(temp_ / "spool");
  SpoolDoor door_{spool_, kMostLog};
  const AccessConfig access_;
  const HttpLimits limits_ = Limits();
  ReaderPool readers_{temp_ / "no-store"};
  AccessLog log_{[](AccessLog::Change) { return absl::OkStatus(); }, SystemClock()};
  Metrics metrics_;
  Guard guard_{{.access = access_,
                .limits = limits_,
                .readers = readers_,
                .log = log_,
                .clock = SystemClock(),
                .leases = &door_}};
  std::optional<UnixHttpServer> server_{std::in_place, limits_, temp_.path().string()};
  Routes routes_{server_->router(), guard_, metrics_};
  std::optional<LeaseFolder> lease_;
  std::string token_;
};

TEST_F(LeaseResourceTest, ALeaseGoesToANodeAndBack) {
  const auto node = Node();
  const auto order = node->Order();
  ASSERT_TRUE(order.ok()) << order.status();
  EXPECT_EQ(order->name, kAttempt);

  const std::string archive(300'000, 'a');
  ASSERT_TRUE(spool_.PutArtefact(order->artefact->digest, BytesOf(File(archive).get()), 1 << 20).ok());
  NodeArtefact artefact = *order->artefact;
  artefact.archive_bytes = 300'000;
  Fd file = File("");
  ASSERT_EQ(node->FetchArtefact(artefact, file.get()), absl::OkStatus());
  EXPECT_EQ(*ReadFile(temp_ / "file"), archive);
  artefact.archive_bytes = 299'999;
  EXPECT_TRUE(absl::IsDataLoss(node->FetchArtefact(artefact, file.get())));

  const NodeClaim claim = {"n1", "7_1", 0, "0123456789abcdef"};
  ASSERT_EQ(node->PutClaim(claim), absl::OkStatus());
  ASSERT_EQ(node->PutClaim(claim), absl::OkStatus());
  EXPECT_TRUE(absl::IsAlreadyExists(Node()->PutClaim({"n2", "7_1", 1, "fedcba9876543210"})));
  EXPECT_EQ(lease_->Claim()->node, "n1");
  NodeProof proof;
  proof.node = "n1";
  proof.version = "0.1.0";
  proof.grader = "{}";
  ASSERT_EQ(node->PutProof(proof), absl::OkStatus());
  EXPECT_TRUE(lease_->Proof().ok());

  ASSERT_EQ(node->AddRecords(0, ""), absl::OkStatus());
  ASSERT_EQ(node->AddRecords(0, "one\n"), absl::OkStatus());
  ASSERT_EQ(node->AddRecords(0, "one\ntwo\n"), absl::OkStatus());
  EXPECT_EQ(*lease_->Records(0, 100), "one\ntwo\n");
  EXPECT_TRUE(absl::IsDataLoss(node->AddRecords(9, "gap")));
  const std::string large = std::string(1 << 20, 'r') + "\n";
  ASSERT_EQ(node->AddRecords(8, large), absl::OkStatus());
  EXPECT_EQ(*lease_->RecordsSize(), 8 + static_cast<int64_t>(large.size()));

  const std::string log = std::string(64, '1') + ".lcmlog.zst";
  ASSERT_EQ(node->PutLog(log, File(std::string(kMostLog, 'l')).get()), absl::OkStatus());
  EXPECT_EQ(ReadAll(lease_->OpenLog(log)->get(), log)->size(), static_cast<size_t>(kMostLog));
  EXPECT_FALSE(node->PutLog(log, File(std::string(kMostLog + 1, 'l')).get()).ok());

  NodeEnd end;
  end.records_sha256 = Sha256Hex("");
  ASSERT_EQ(node->PutEnd(end), absl::OkStatus());
  EXPECT_TRUE(lease_->End().ok());
  ASSERT_TRUE(lease_->Stop().ok());
  EXPECT_TRUE(absl::IsCancelled(node->AddRecords(8, "")));
}

TEST_F(LeaseResourceTest, AnAttemptThatIsOverIsOverForItsToken) {
  const auto node = Node();
  ASSERT_TRUE(node->Order().ok());
  door_.Close(kAttempt);
  EXPECT_THAT(std::string(node->Order().status().message()), HasSubstr("410"));
  EXPECT_TRUE(absl::IsCancelled(node->AddRecords(0, "x")));
  EXPECT_TRUE(absl::IsCancelled(node->PutLog(std::string(64, '1') + ".lcmlog.zst",
                                             File(std::string(90'000, 'l')).get())));
  EXPECT_EQ(*lease_->RecordsSize(), 0);
}

TEST_F(LeaseResourceTest, NoOtherTokenOpensIt) {
  const std::string other = "12-2-fedcba9876543210";
  ASSERT_TRUE(spool_.MakeLease(other).ok());
  const std::string others_token = *door_.Open(other, "");
  for (const std::string& token : {others_token, std::string(64, '0'), std::string("x")}) {
    const absl::Status status = ChannelOf(kAttempt, token)->AddRecords(0, "x");
    EXPECT_TRUE(absl::IsFailedPrecondition(status) || absl::IsUnavailable(status)) << status;
    EXPECT_THAT(std::string(status.message()), testing::AnyOf(HasSubstr("401"), HasSubstr("429")));
  }
  EXPECT_EQ(*lease_->RecordsSize(), 0);
  // Its own is not held up by those who guess.
  EXPECT_EQ(Node()->AddRecords(0, "x"), absl::OkStatus());
}

TEST_F(LeaseResourceTest, ADaemonThatIsAwayIsAskedAgain) {
  const auto node = Node();
  ASSERT_EQ(node->AddRecords(0, ""), absl::OkStatus());
  server_->Shutdown();
  const absl::Status status = node->AddRecords(0, "x");
  EXPECT_TRUE(ChannelMayRecover(status)) << status;
}

TEST_F(LeaseResourceTest, TokensGoToNobodyButTheDaemon) {
  for (const char* url : {"http://example.org:8443", "ftp://127.0.0.1:1", "example.org", ""}) {
    EXPECT_FALSE(HttpChannel::Open({url, kAttempt, "token", ""}).ok()) << url;
  }
  EXPECT_FALSE(HttpChannel::Open({"https://example.org", kAttempt, "", ""}).ok());
}

}  // namespace
}  // namespace myograde::server
