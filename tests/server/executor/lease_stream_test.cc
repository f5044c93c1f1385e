// Messages between the two ends of a lease: whole, in order, however their bytes arrive.
#include "server/executor/slurm/lease_stream.h"

#include <fcntl.h>

#include <gtest/gtest.h>

#include "protocol/base/spawn.h"

namespace myograde::server {
namespace {

class LeaseStreamTest : public ::testing::Test {
 protected:
  LeaseStreamTest() : pipe_(*MakePipe()), stream_(pipe_.read.get(), pipe_.write.get(), 100) {}

  Pipe pipe_;
  LeaseStream stream_;
};

TEST_F(LeaseStreamTest, MessagesArriveAsTheyWereSent) {
  ASSERT_TRUE(stream_.Send("log", std::string("a\n\0b", 4)).ok());
  ASSERT_TRUE(stream_.Send("data", "").ok());
  ASSERT_TRUE(stream_.Fill().ok());
  EXPECT_EQ((*stream_.Next())->bytes, std::string("a\n\0b", 4));
  EXPECT_EQ((*stream_.Next())->kind, "data");
  EXPECT_EQ(*stream_.Next(), std::nullopt);
  ASSERT_TRUE(stream_.Send("end", "x").ok());
  EXPECT_EQ(*stream_.Await("end", absl::Seconds(10)), "x");
}

TEST_F(LeaseStreamTest, TheEndIsToldFromHalfAMessage) {
  stream_.Append("rec");
  EXPECT_EQ(*stream_.Next(), std::nullopt);
  pipe_.write.reset();
  EXPECT_TRUE(absl::IsDataLoss(stream_.Fill()));
  stream_.Append("ord 2\nab\n");
  EXPECT_EQ((*stream_.Next())->kind, "record");
  EXPECT_TRUE(absl::IsOutOfRange(stream_.Fill()));
}

TEST_F(LeaseStreamTest, WaitingHasADeadlineAndAnOrder) {
  EXPECT_TRUE(absl::IsDeadlineExceeded(stream_.Await("order", absl::Milliseconds(20)).status()));
  stream_.Append("node 1\nx\n");
  EXPECT_TRUE(absl::IsDataLoss(stream_.Await("order", absl::Seconds(10)).status()));
}

TEST_F(LeaseStreamTest, WhatIsNoMessageIsRefused) {
  for (const char* bytes : {"what is this, which has no size at all", "record -1\n", "record +1\na\n",
                            "record 1x\na\n", "record\n", "record 101\n", "record 1\nab"}) {
    LeaseStream stream(-1, -1, 100);
    stream.Append(bytes);
    EXPECT_TRUE(absl::IsDataLoss(stream.Next().status())) << bytes;
  }
}

}  // namespace
}  // namespace myograde::server
