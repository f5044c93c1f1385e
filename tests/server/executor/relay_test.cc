// What a lease's runner prints on its way back, over a channel that fails in all ways.
#include "server/executor/node/relay.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>

#include <functional>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <gtest/gtest.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

// Keeps what arrives; fails as told.
class FakeChannel : public LeaseChannel {
 public:
  absl::StatusOr<NodeOrder> Order() override { return absl::NotFoundError("none"); }
  absl::Status PutClaim(const NodeClaim&) override { return absl::OkStatus(); }
  absl::Status PutProof(const NodeProof&) override { return absl::OkStatus(); }
  absl::Status FetchArtefact(const NodeArtefact&, int) override { return absl::OkStatus(); }
  absl::Status AddRecords(int64_t offset, std::string_view bytes) override {
    const MutexLock lock(mutex_);
    ++looks_;
    if (!fault_.ok()) return fault_;
    EXPECT_EQ(offset, static_cast<int64_t>(records_.size()));
    records_ += bytes;
    if (!bytes.empty()) all_ += absl::StrCat("[", std::string(bytes), "]");
    return absl::OkStatus();
  }
  absl::Status PutLog(const std::string& log, int file) override {
    const MutexLock lock(mutex_);
    EXPECT_GE(file, 0);
    if (!fault_.ok()) return fault_;
    all_ += absl::StrCat("<", log, ">");
    return absl::OkStatus();
  }
  absl::Status PutEnd(const NodeEnd& end) override {
    const MutexLock lock(mutex_);
    if (!end_fault_.ok()) return end_fault_;
    ends_.push_back(end);
    return absl::OkStatus();
  }

  void Fail(const absl::Status& fault, const absl::Status& end_fault) {
    const MutexLock lock(mutex_);
    fault_ = fault;
    end_fault_ = end_fault;
  }
  std::string all() {
    const MutexLock lock(mutex_);
    return all_;
  }
  std::vector<NodeEnd> ends() {
    const MutexLock lock(mutex_);
    return ends_;
  }
  int looks() {
    const MutexLock lock(mutex_);
    return looks_;
  }

 private:
  Mutex mutex_;
  absl::Status fault_ ABSL_GUARDED_BY(mutex_);
  absl::Status end_fault_ ABSL_GUARDED_BY(mutex_);
  std::string records_ ABSL_GUARDED_BY(mutex_);
  std::string all_ ABSL_GUARDED_BY(mutex_);
  std::vector<NodeEnd> ends_ ABSL_GUARDED_BY(mutex_);
  int looks_ ABSL_GUARDED_BY(mutex_) = 0;
};

constexpr RelayLimits kQuickLimits = {.most_kept = 1000,
                                      .beat = absl::Milliseconds(20),
                                      .first_delay = absl::Milliseconds(10),
                                      .longest_delay = absl::Milliseconds(50),
                                      .cut_after = absl::Seconds(60)};

void Await(const std::function<bool()>& holds) {
  const Deadline deadline(absl::Seconds(60));
  while (!holds()) {
    ASSERT_FALSE(deadline.over());
    absl::SleepFor(absl::Milliseconds(5));
  }
}

Fd SomeFile() { return Fd(memfd_create("log", MFD_CLOEXEC)); }

TEST(Relay, EverythingArrivesInItsOrderAndTheEndLast) {
  FakeChannel channel;
  Relay relay(channel, kQuickLimits);
  relay.AddRecords("a\n");
  relay.AddLog("log", SomeFile());
  relay.AddRecords("b\n");
  relay.AddRecords("c\n");
  NodeEnd end;
  end.wait_status = 9;
  relay.AddEnd(end);
  Await([&] { return relay.over(); });
  EXPECT_EQ(channel.all(), "[a\n]<log>[b\nc\n]");
  ASSERT_EQ(channel.ends().size(), 1u);
  EXPECT_EQ(channel.ends()[0].records_bytes, 6);
  EXPECT_EQ(channel.ends()[0].records_sha256, Sha256Hex("a\nb\nc\n"));
  EXPECT_EQ(channel.ends()[0].wait_status, 9);
  EXPECT_EQ(relay.status(), absl::OkStatus());
}

TEST(Relay, LooksAfterTheLeaseWithoutNews) {
  FakeChannel channel;
  Relay relay(channel, kQuickLimits);
  Await([&] { return channel.looks() > 3; });
  channel.Fail(absl::CancelledError("stop"), absl::OkStatus());
  pollfd wake = {relay.wake_fd(), POLLIN, 0};
  EXPECT_EQ(poll(&wake, 1, 60'000), 1);
  EXPECT_TRUE(absl::IsCancelled(relay.status()));
  // The last words may still be said, without what was not sent.
  relay.AddRecords("late\n");
  relay.EndNow({});
  Await([&] { return relay.over(); });
  EXPECT_EQ(channel.ends().size(), 1u);
  EXPECT_EQ(channel.all(), "");
}

TEST(Relay, WhatFailsIsTriedAgainUntilItPasses) {
  for (const absl::Status& fault :
       {absl::ResourceExhaustedError("full"), absl::UnavailableError("stale"),
        absl::DeadlineExceededError("slow")}) {
    FakeChannel channel;
    channel.Fail(fault, fault);
    Relay relay(channel, kQuickLimits);
    relay.AddRecords("a\n");
    relay.AddEnd({});
    Await([&] { return channel.looks() > 3; });
    EXPECT_FALSE(relay.over());
    EXPECT_EQ(relay.status(), absl::OkStatus());
    channel.Fail(absl::OkStatus(), absl::OkStatus());
    Await([&] { return relay.over(); });
    EXPECT_EQ(channel.all(), "[a\n]");
    EXPECT_EQ(channel.ends().size(), 1u);
  }
}

TEST(Relay, AWayThatStaysCutIsGivenUp) {
  FakeChannel channel;
  channel.Fail(absl::UnavailableError("away"), absl::UnavailableError("away"));
  RelayLimits limits = kQuickLimits;
  limits.cut_after = absl::Milliseconds(200);
  Relay relay(channel, limits);
  relay.AddRecords("a\n");
  Await([&] { return !relay.status().ok(); });
  EXPECT_TRUE(absl::IsUnavailable(relay.status()));
  relay.EndNow({});
  Await([&] { return relay.over(); });
  EXPECT_TRUE(channel.ends().empty());
}

TEST(Relay, WhatCanNeverPassIsGivenUpAtOnce) {
  FakeChannel channel;
  channel.Fail(absl::DataLossError("other records"), absl::OkStatus());
  Relay relay(channel, kQuickLimits);
  relay.AddRecords("a\n");
  Await([&] { return !relay.status().ok(); });
  EXPECT_TRUE(absl::IsDataLoss(relay.status()));
}

TEST(Relay, MemoryIsBounded) {
  FakeChannel channel;
  channel.Fail(absl::ResourceExhaustedError("full"), absl::ResourceExhaustedError("full"));
  Relay relay(channel, kQuickLimits);
  for (int i = 0; i < 11; ++i) relay.AddRecords(std::string(100, 'r'));
  EXPECT_TRUE(absl::IsResourceExhausted(relay.status()));
}

}  // namespace
}  // namespace myograde::server
