// New connections while all places are busy.
#include <set>

#include "tests/server/http/http_server_world.h"

namespace myograde::server {
namespace {

using ::testing::StartsWith;

TEST_F(HttpServerTest, WhoFindsAllPlacesBusyIsLetInAfterAnAnswer) {
  Start(Limits());
  const auto busy = AllBusy("a");
  Client waiting(path(), "a");
  waiting.Send(kGet);
  Client next(path(), "a");
  next.Send(kGet);
  AwaitAllSeen();
  EXPECT_EQ(waiting.Receive(1, absl::Milliseconds(500)), "") << "neither answered nor refused";
  permits_.release(2);
  // Any two get their current answers and then give way, whatever else they have requested.
  std::set<size_t> gave_way;
  for (size_t i = 0; i < 1000 && gave_way.size() < 2; ++i) {
    const size_t one = i % busy.size();
    if (busy[one]->Receive(1000, absl::Milliseconds(20)) == kOk) gave_way.insert(one);
  }
  EXPECT_EQ(gave_way.size(), 2u);
  permits_.release(100);
  EXPECT_EQ(waiting.Receive(sizeof(kOk) - 1), kOk);
  EXPECT_EQ(next.Receive(sizeof(kOk) - 1), kOk);
  // With nobody waiting, the others get everything that they requested.
  for (size_t i = 0; i < busy.size(); ++i) {
    const std::string rest = gave_way.contains(i) ? "" : absl::StrCat(kOk, kOk, kOk);
    EXPECT_EQ(busy[i]->Receive(3 * (sizeof(kOk) - 1)), rest);
  }
}

TEST_F(HttpServerTest, WhoWaitsInLineIsToldInTheEnd) {
  HttpLimits limits = Limits();
  limits.request = absl::Seconds(1);
  Start(limits);
  const auto busy = AllBusy("a");
  Client waiting(path(), "a");
  waiting.Send(kGet);
  EXPECT_THAT(waiting.Receive(1000), StartsWith("HTTP/1.1 429"));
}

TEST_F(HttpServerTest, TheLineIsBounded) {
  Start(Limits());
  const auto busy = AllBusy("a");
  auto line = Many(Limits().peer_waiting(), "a", kGet);
  Client late(path(), "a");
  EXPECT_THAT(late.Receive(1000), StartsWith("HTTP/1.1 429"));
  // Hanging up while waiting frees a place in the line.
  line.clear();
  std::string told = "HTTP/1.1 429";
  for (int i = 0; i < 100 && !told.empty(); ++i) {
    told = Client(path(), "a").Receive(12, absl::Milliseconds(300));
  }
  EXPECT_EQ(told, "");
}

TEST_F(HttpServerTest, NobodyGivesWayToWhoHasHungUp) {
  Start(Limits());
  const auto busy = AllBusy("a");
  Client(path(), "a").Send(kGet);
  AwaitAllSeen();
  permits_.release(1000);
  for (const auto& client : busy) {
    EXPECT_EQ(client->Receive(3 * (sizeof(kOk) - 1)), absl::StrCat(kOk, kOk, kOk));
  }
}

TEST_F(HttpServerTest, ThoseInLineHearOfAStop) {
  Start(Limits());
  const auto busy = AllBusy("a");
  Client first(path(), "a");
  AwaitAllSeen();
  server_->BeginStop();
  EXPECT_THAT(first.Receive(12), "HTTP/1.1 503");
  EXPECT_THAT(Client(path(), "a").Receive(12), "HTTP/1.1 503") << "who comes later, too";
}

}  // namespace
}  // namespace myograde::server
