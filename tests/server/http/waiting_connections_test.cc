#include "server/http/connection_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <set>
#include <string>

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr absl::Duration kEarly = absl::Seconds(1);
constexpr absl::Duration kLate = absl::Seconds(100);

class WaitingConnectionsTest : public ::testing::Test {
 protected:
  // The other end of a connection added to `line`.
  static Fd Add(WaitingConnections& line, const std::string& key, absl::Duration until = kLate) {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    line.Add({Fd(ends[0]), Peer{key, key == "root", 1}}, until);
    return Fd(ends[1]);
  }
  // What a connection was sent; "" while it waits.
  static std::string ToldTo(const Fd& end) {
    char text[512];
    const ssize_t n = ::recv(end.get(), text, sizeof(text), MSG_DONTWAIT);
    return std::string(text, static_cast<size_t>(std::max<ssize_t>(n, 0)));
  }
  // Lets in as many as `places` says; returns the keys in order of admission.
  static std::vector<std::string> LetIn(WaitingConnections& line, int places,
                                        const std::set<std::string>& full = {}) {
    std::vector<std::string> in;
    line.LetIn([&](const Peer& peer) { return places > 0 && !full.contains(peer.key); },
               [&](AcceptedSocket one) {
                 --places;
                 in.push_back(one.peer.key);
               });
    return in;
  }
};

TEST_F(WaitingConnectionsTest, OrganisersComeFirstAndPeersTakeTurns) {
  WaitingConnections line(10, 10);
  std::vector<Fd> ends;
  for (const char* key : {"a", "a", "a", "a", "b", "b", "root"}) ends.push_back(Add(line, key));
  EXPECT_THAT(LetIn(line, 4), ElementsAre("root", "a", "b", "a"));
  // Places that become free one by one rotate as well.
  EXPECT_THAT(LetIn(line, 1), ElementsAre("b"));
  EXPECT_THAT(LetIn(line, 9), ElementsAre("a", "a"));
  EXPECT_TRUE(line.empty());
}

TEST_F(WaitingConnectionsTest, APeerWithoutAPlaceHoldsUpNoOther) {
  WaitingConnections line(10, 10);
  const Fd a = Add(line, "a"), b = Add(line, "b");
  EXPECT_THAT(LetIn(line, 9, {"a"}), ElementsAre("b"));
  EXPECT_TRUE(line.Has(Peer{.key = "a"}));
  EXPECT_FALSE(line.Has(Peer{.key = "b"}));
}

TEST_F(WaitingConnectionsTest, OnePeerHasABoundOfItsOwn) {
  WaitingConnections line(10, 2);
  const Fd first = Add(line, "a"), second = Add(line, "a"), third = Add(line, "a");
  const Fd other = Add(line, "b");
  EXPECT_THAT(ToldTo(third), StartsWith("HTTP/1.1 429"));
  for (const Fd* end : {&first, &second, &other}) EXPECT_EQ(ToldTo(*end), "");
}

TEST_F(WaitingConnectionsTest, AFullLineSendsTheLastOfTheLongestAway) {
  WaitingConnections line(4, 4);
  const Fd first = Add(line, "a"), second = Add(line, "a"), third = Add(line, "a"),
           fourth = Add(line, "a");
  const Fd other = Add(line, "b"), another = Add(line, "b"), last = Add(line, "b");
  EXPECT_THAT(ToldTo(fourth), StartsWith("HTTP/1.1 429"));
  EXPECT_THAT(ToldTo(third), StartsWith("HTTP/1.1 429"));
  EXPECT_THAT(ToldTo(last), StartsWith("HTTP/1.1 429")) << "has no fewer than the other";
  EXPECT_THAT(LetIn(line, 9), ElementsAre("a", "b", "a", "b"));
}

TEST_F(WaitingConnectionsTest, NobodyWaitsForLongerThanItsTime) {
  WaitingConnections line(10, 10);
  const Fd early = Add(line, "a", kEarly), late = Add(line, "a");
  line.LookAtClocks(kEarly - absl::Milliseconds(1));
  EXPECT_EQ(ToldTo(early), "");
  line.LookAtClocks(kEarly);
  EXPECT_THAT(ToldTo(early), StartsWith("HTTP/1.1 429"));
  EXPECT_EQ(ToldTo(late), "");
  line.RejectAll({503, "stopping", "later"});
  EXPECT_THAT(ToldTo(late), StartsWith("HTTP/1.1 503"));
  EXPECT_TRUE(line.empty());
}

TEST_F(WaitingConnectionsTest, WhoHasHungUpIsForgotten) {
  WaitingConnections line(10, 10);
  Add(line, "a").reset();
  Add(line, "b").reset();
  const Fd silent = Add(line, "a");
  ::shutdown(silent.get(), SHUT_WR);  // finished sending, and still wants its answer
  EXPECT_THAT(LetIn(line, 9), ElementsAre("a"));
  EXPECT_TRUE(line.empty());
  Add(line, "a").reset();
  line.LookAtClocks(kEarly);
  EXPECT_TRUE(line.empty());
  EXPECT_THAT(LetIn(line, 9), IsEmpty());
}

}  // namespace
}  // namespace myograde::server
