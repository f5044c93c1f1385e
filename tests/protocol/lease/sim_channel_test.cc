#include "protocol/lease/sim_channel.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <string>
#include <utility>

#include <gtest/gtest.h>

namespace myograde {
namespace {

std::pair<Fd, Fd> Pair() {
  int ends[2];
  EXPECT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends), 0);
  return {Fd(ends[0]), Fd(ends[1])};
}

TEST(SimChannel, CarriesMessagesAndDescriptors) {
  auto [here, there] = Pair();
  int ends[2];
  ASSERT_EQ(pipe2(ends, O_CLOEXEC), 0);
  const Fd reader(ends[0]);
  Fd writer(ends[1]);
  ASSERT_TRUE(SendSimMessage(here.get(), {{"type", "policy"}}, writer.get()).ok());
  ASSERT_TRUE(SendSimMessage(here.get(), {{"type", "done"}}).ok());
  writer.reset();
  auto first = ReceiveSimMessage(there.get(), absl::Seconds(5));
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(first->json["type"], "policy");
  ASSERT_TRUE(first->fd.valid());
  EXPECT_EQ(write(first->fd.get(), "x", 1), 1);
  char c = 0;
  EXPECT_EQ(read(reader.get(), &c, 1), 1);
  EXPECT_NE(fcntl(first->fd.get(), F_GETFD) & FD_CLOEXEC, 0);
  const auto second = ReceiveSimMessage(there.get(), absl::Seconds(5));
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_FALSE(second->fd.valid());
}

TEST(SimChannel, WaitsNoLongerThanAsked) {
  auto [here, there] = Pair();
  EXPECT_TRUE(absl::IsDeadlineExceeded(
      ReceiveSimMessage(there.get(), absl::Milliseconds(30)).status()));
  EXPECT_TRUE(
      absl::IsDeadlineExceeded(ReceiveSimMessage(there.get(), absl::ZeroDuration()).status()));
}

TEST(SimChannel, TellsWhenThePeerIsGone) {
  auto [here, there] = Pair();
  here.reset();
  EXPECT_TRUE(absl::IsUnavailable(ReceiveSimMessage(there.get(), absl::Seconds(5)).status()));
  EXPECT_TRUE(absl::IsUnavailable(SendSimMessage(there.get(), {{"type", "done"}})));
}

TEST(SimChannel, RefusesNonsense) {
  auto [here, there] = Pair();
  for (const std::string text : {"{", "[]", "{}", R"({"type":3})", "\xff"}) {
    ASSERT_EQ(send(here.get(), text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
    EXPECT_TRUE(
        absl::IsInvalidArgument(ReceiveSimMessage(there.get(), absl::Seconds(5)).status()))
        << text;
  }
  const std::string huge(140000, ' ');
  ASSERT_EQ(send(here.get(), huge.data(), huge.size(), 0), 140000);
  EXPECT_TRUE(absl::IsInvalidArgument(ReceiveSimMessage(there.get(), absl::Seconds(5)).status()));
  EXPECT_TRUE(
      absl::IsInvalidArgument(SendSimMessage(here.get(), {{"type", std::string(140000, 'x')}})));
}

}  // namespace
}  // namespace myograde
