// Refusals that are to be heard.
#include "tests/server/api/gate_world.h"

namespace myograde::server {
namespace {

using ::testing::StartsWith;

TEST_F(GateTest, ARefusedBodyIsReadSoThatItsSenderHearsWhy) {
  Start(Limits());
  for (const char* head : {"POST /upload HTTP/1.1\r\nContent-Length: 20000000\r\n\r\n",
                           "POST /upload HTTP/1.1\r\nContent-Length: 5000000\r\n"
                           "Content-Type: multipart/form-data; boundary=x\r\n\r\n"}) {
    Client client(path(), "a");
    client.Send(head);
    client.Send(std::string(5'000'000, 'x'));  // would fail half-way if nobody read it
    EXPECT_THAT(client.Receive(10), "HTTP/1.1 4");
  }
  EXPECT_EQ(body_bytes_, 0);
}

// The head and so much of the body come in one piece, so that they are there when it is refused.
TEST_F(GateTest, WhatCameBeforeARefusalIsCountedOnce) {
  constexpr int64_t kBefore = 20'000;
  Start(Limits());
  for (const int64_t after : {kBefore, int64_t{1}, int64_t{300'000}}) {
    Client client(path(), "a");
    client.Send(absl::StrCat("POST /upload HTTP/1.1\r\nContent-Type: text/plain\r\n",
                             "Content-Length: ", kBefore + after, "\r\n\r\n",
                             std::string(kBefore, 'x')));
    EXPECT_THAT(client.Receive(1 << 20), StartsWith("HTTP/1.1 415")) << after;
    EXPECT_FALSE(client.Closed(absl::Milliseconds(300))) << "the rest is still to come: " << after;
    client.Send(std::string(static_cast<size_t>(after), 'y'));
    EXPECT_TRUE(client.Closed(absl::Seconds(60))) << "all of it has come: " << after;
  }
}

TEST_F(GateTest, WhoBringsTooManyBodiesHearsSoAfterTheRestOfItToo) {
  Start(Limits());
  const auto crowd = Many(Limits().peer_clients / 2, "a", Upload(1000) + "x");
  AwaitAllSeen();
  Client client(path(), "a");
  client.Send(Upload(1000) + "x");
  EXPECT_THAT(client.Receive(1 << 20), StartsWith("HTTP/1.1 429"));
  EXPECT_FALSE(client.Closed(absl::Milliseconds(300)));
  client.Send(std::string(999, 'x'));
  EXPECT_TRUE(client.Closed(absl::Seconds(60)));
}

}  // namespace
}  // namespace myograde::server
