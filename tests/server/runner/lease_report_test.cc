#include "server/runner/lease_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocol/lease/policy_seed.h"
#include "server/runner/runner_process.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

constexpr absl::Duration kStart = absl::Seconds(100);

std::vector<EpisodeOrder> SomeEpisodes(int64_t count) {
  std::vector<EpisodeOrder> episodes;
  for (int64_t i = 0; i < count; ++i) {
    episodes.push_back({10 + i, static_cast<uint64_t>(70 + i), 0});
  }
  return episodes;
}

EpisodeFacts Facts(int64_t index, uint64_t seed) {
  EpisodeFacts facts;
  facts.index = index;
  facts.seed = seed;
  return facts;
}

LeaseEndRecord End(bool ok = true, const std::string& detail = "") {
  LeaseEndRecord end;
  end.ok = ok;
  end.detail = detail;
  return end;
}

TEST(LeaseReport, IsDoneWhenEveryEpisodeAndTheLastRecordWereTold) {
  LeaseReport report(SomeEpisodes(2), {}, kStart);
  const auto news = report.Take({ProgressRecord{10, 5}, Facts(10, 70)}, kStart);
  EXPECT_EQ(news.progress->step, 5);
  EXPECT_EQ(news.episodes.size(), 1u);
  EXPECT_EQ(report.Take({Facts(11, 71), End()}, kStart).episodes.size(), 1u);
  report.Conclude(0, "");
  EXPECT_EQ(report.fault(), "");
  EXPECT_EQ(report.reported(), 2);
}

TEST(LeaseReport, WhatWasNotOrderedIsAFaultAndNothingCountsAfterIt) {
  for (const EpisodeFacts& wrong : {Facts(9, 69), Facts(12, 72), Facts(10, 71)}) {
    LeaseReport report(SomeEpisodes(2), {}, kStart);
    const auto news = report.Take({wrong, Facts(10, 70), End()}, kStart);
    EXPECT_THAT(report.fault(), HasSubstr("which the lease did not ask for"));
    EXPECT_TRUE(news.episodes.empty());
    EXPECT_FALSE(report.end().has_value());
  }
  LeaseReport report(SomeEpisodes(2), {}, kStart);
  EXPECT_EQ(report.Take({Facts(10, 70), Facts(10, 70)}, kStart).episodes.size(), 1u);
  EXPECT_THAT(report.fault(), HasSubstr("twice"));
}

TEST(LeaseReport, TheFirstReasonStays) {
  LeaseReport report(SomeEpisodes(1), {.deadline = kStart}, kStart);
  report.Fail("the disk is full");
  report.Tick(kStart + absl::Hours(1));
  report.Conclude(9, "words");
  EXPECT_EQ(report.fault(), "the disk is full");
}

TEST(LeaseReport, ARunnerThatIsLateOrSilentIsFaultyUnlessItHasToldAll) {
  const LeaseReport::Limits limits = {.deadline = kStart + absl::Seconds(60),
                                      .silence = absl::Seconds(10)};
  LeaseReport silent(SomeEpisodes(1), limits, kStart);
  silent.Tick(kStart + absl::Seconds(10));
  EXPECT_FALSE(silent.faulty());
  silent.Tick(kStart + absl::Seconds(11));
  EXPECT_EQ(silent.fault(), "the runner was silent for 10s");

  LeaseReport late(SomeEpisodes(1), limits, kStart);
  for (int s = 5; s <= 60; s += 5) late.Take({ProgressRecord{}}, kStart + absl::Seconds(s));
  late.Tick(kStart + absl::Seconds(61));
  EXPECT_EQ(late.fault(), "the runner did not end in its time");

  LeaseReport told(SomeEpisodes(1), limits, kStart);
  told.Take({Facts(10, 70), End()}, kStart + absl::Seconds(1));
  told.Tick(kStart + absl::Hours(1));
  EXPECT_FALSE(told.faulty());
  EXPECT_FALSE(told.lingers(kStart + absl::Seconds(2)));
  EXPECT_TRUE(told.lingers(kStart + absl::Seconds(5)));
}

TEST(LeaseReport, AnEndThatIsNoneTellsWhatIsKnown) {
  LeaseReport without(SomeEpisodes(1), {}, kStart);
  without.Conclude(9, "first\nthe last line\n");
  EXPECT_EQ(without.fault(), "the runner ended (signal 9) without its last record; its last words: "
                             "the last line");
  LeaseReport refused(SomeEpisodes(1), {}, kStart);
  refused.Take({End(false, "the models are gone")}, kStart);
  refused.Conclude(0, "");
  EXPECT_EQ(refused.fault(), "the models are gone");
  LeaseReport short_one(SomeEpisodes(3), {}, kStart);
  short_one.Take({Facts(11, 71), End()}, kStart);
  short_one.Conclude(0, "");
  EXPECT_EQ(short_one.fault(), "the runner said done after 1 of 3 episodes");
}

TEST(LeaseReport, ReplaysAreToldByTheirEpisode) {
  LeaseReport report(SomeEpisodes(2), {}, kStart);
  ReplayRecord replay;
  replay.episode = 11;
  EXPECT_EQ(report.Take({replay}, kStart).replays.size(), 1u);
  replay.episode = 3;
  report.Take({replay}, kStart);
  EXPECT_THAT(report.fault(), HasSubstr("episode 3, which the lease did not ask for"));
}

// Whatever a runner reports, in whatever pieces: no episode is returned twice or unordered, and the
// lease is done if and only if each was reported once, in any order, before a valid end record.
RC_GTEST_PROP(LeaseReport, GivesEachOrderedEpisodeAtMostOnce, ()) {
  const int64_t count = *rc::gen::inRange<int64_t>(1, 5);
  LeaseReport report(SomeEpisodes(count), {}, kStart);
  std::multiset<int64_t> given;
  bool right = true;   // only what was ordered, each once
  bool ended = false;
  bool ended_well = false;
  const int pieces = *rc::gen::inRange(0, 8);
  for (int piece = 0; piece < pieces && !ended; ++piece) {
    std::vector<LeaseRecord> records;
    const int size = *rc::gen::inRange(0, 3);
    for (int i = 0; i < size && !ended; ++i) {
      const int kind = *rc::gen::inRange(0, 8);
      if (kind == 0) {
        records.emplace_back(ProgressRecord{});
      } else if (kind == 1) {
        ended = true;
        ended_well = *rc::gen::arbitrary<bool>();
        records.emplace_back(End(ended_well, ended_well ? "" : "a fault"));
      } else {
        const int64_t index = *rc::gen::inRange<int64_t>(10, 10 + count + (kind == 2 ? 1 : 0));
        records.emplace_back(Facts(index, static_cast<uint64_t>(60 + index)));
      }
    }
    for (const EpisodeFacts& facts : report.Take(records, kStart).episodes) {
      given.insert(facts.index);
    }
  }
  for (const int64_t index : given) {
    RC_ASSERT(index >= 10 && index < 10 + count);
    RC_ASSERT(given.count(index) == 1u);
  }
  right = !report.faulty();
  report.Conclude(0, "");
  const bool all = std::ssize(given) == count;
  RC_ASSERT(report.faulty() == !(right && all && ended && ended_well));
}

TEST(LeaseOrder, HasTheSeedsOfItsEpisodes) {
  TrackConfig track;
  track.policy_seed_secret = "secret";
  const std::vector<uint64_t> seeds = {5, 6, 7, 8};
  const auto episodes = EpisodesOf(track, seeds, 1, 2);
  ASSERT_EQ(episodes.size(), 2u);
  EXPECT_EQ(episodes[0].index, 1);
  EXPECT_EQ(episodes[0].seed, 6u);
  EXPECT_EQ(episodes[1].policy_seed, PolicySeed("secret", 2));
  const LeaseOrder order = MakeLeaseOrder(
      "7-1", track, episodes, {.artefact_dir = "/a", .command = {"./p"}, .environment = {},
                               .runtimes = {}},
      {.slot = 3, .uid = 100, .pinned = true, .work_dir = "/w", .cache_dir = "/c", .log_dir = "/l"});
  EXPECT_EQ(order.lease, "7-1");
  EXPECT_EQ(order.slot, 3);
  EXPECT_EQ(order.uid, 100);
  EXPECT_TRUE(order.pinned);
  EXPECT_TRUE(order.replay.empty());
}

}  // namespace
}  // namespace myograde::server
