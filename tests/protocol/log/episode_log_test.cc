#include "protocol/log/episode_log.h"

#include <cstring>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/policy/channels.h"
#include "protocol/log/event_log.h"
#include "protocol/bridge/leg_sets_json.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;

TrackConfig Leg() {
  absl::StatusOr<TrackConfig> track =
      LoadTrackConfig(std::string(MYOGRADE_SOURCE_DIR) + "/configs/tracks", "locomotion", "");
  return *WithSeeds(*track, {4242});
}

LegParameterSets TwoSets() {
  LegParameterSets sets = {};
  sets.present = 0b10001;
  double value = 0.1;
  for (const int set : {0, 4}) {
    for (LegStateParameters& state : sets.set[set]) {
      for (double* number : {&state.knee_stiffness, &state.knee_damping, &state.knee_target,
                             &state.ankle_stiffness, &state.ankle_damping, &state.ankle_target}) {
        *number = value += 1.0 / 3;
      }
      for (int i = 0; i < kLegQuantities; ++i) {
        state.threshold[i] = value *= -1.25;
        state.threshold_kind[i] = static_cast<uint8_t>(i % 3);
      }
    }
  }
  return sets;
}

std::vector<double> Action(int64_t step) {
  std::vector<double> action(55, static_cast<double>(step) / 7);
  action[54] = 3;
  return action;
}

ShortDigest Digest(int64_t step, const char* of) {
  return Shorten(Sha256Of(std::string(of) + std::to_string(step)));
}

std::string Log(int64_t steps) {
  LogHeader header;
  header.track = Leg();
  header.config = std::string(64, 'c');
  header.episode = 17;
  header.first = false;
  header.seed = 4242;
  EpisodeLogEncoder encoder(0.005);
  std::string log;
  encoder.Header(header, log);
  encoder.Start({ActionConvention::kDirect, LegSetsToJson(TwoSets())}, log);
  for (int64_t step = 0; step < steps; ++step) {
    encoder.Step(Action(step), Digest(step, "o"), Digest(step, "s"), log);
  }
  encoder.End({steps, steps, "fell", std::string(64, 'd')}, Sha256Hex(log), log);
  return log;
}

TEST(EpisodeLog, ComesBack) {
  const auto log = ParseEpisodeLog(Log(3));
  ASSERT_TRUE(log.ok()) << log.status();
  EXPECT_EQ(log->header.track.hash, Leg().hash);
  EXPECT_EQ(log->header.config, std::string(64, 'c'));
  EXPECT_EQ(log->header.episode, 17);
  EXPECT_EQ(log->header.seed, 4242u);
  EXPECT_FALSE(log->header.first);
  EXPECT_TRUE(log->header.begun);
  ASSERT_TRUE(log->start.has_value());
  EXPECT_EQ(log->start->convention, ActionConvention::kDirect);
  const auto sets = LegSetsFromJson(log->start->parameters);
  ASSERT_TRUE(sets.ok()) << sets.status();
  EXPECT_EQ(LegSetsToJson(*sets), LegSetsToJson(TwoSets()));
  EXPECT_EQ(sets->set[4][3].threshold[2], TwoSets().set[4][3].threshold[2]);
  ASSERT_EQ(log->steps(), 3);
  for (int64_t step = 0; step < 3; ++step) {
    const auto action = log->action(step);
    EXPECT_EQ(std::vector<double>(action.begin(), action.end()), Action(step));
    EXPECT_EQ(log->observations[static_cast<size_t>(step)], Digest(step, "o"));
    EXPECT_EQ(log->states[static_cast<size_t>(step)], Digest(step, "s"));
  }
  EXPECT_EQ(log->end.end, "fell");
  EXPECT_EQ(log->end.steps, 3);
}

TEST(EpisodeLog, TimesAreSimulatedAndNumbersHaveNoGap) {
  const std::string log = Log(2);
  EventLogReader reader(log);
  std::vector<std::pair<std::string, int64_t>> events;
  while (true) {
    const auto event = reader.Next();
    ASSERT_TRUE(event.ok());
    if (!event->has_value()) break;
    EXPECT_EQ((*event)->number, static_cast<int64_t>(events.size()));
    events.emplace_back((*event)->channel, (*event)->time_us);
  }
  const std::vector<std::pair<std::string, int64_t>> expected = {
      {std::string(kLogHeaderChannel), 0},    {std::string(kLogStartChannel), 0},
      {std::string(kActionChannel), 0},       {std::string(kLogDigestChannel), 5000},
      {std::string(kActionChannel), 5000},    {std::string(kLogDigestChannel), 10000},
      {std::string(kLogEndChannel), 10000}};
  EXPECT_EQ(events, expected);
}

TEST(EpisodeLog, NoByteCanBeChanged) {
  const std::string log = Log(2);
  // Each takes a whole reading, so of the middle, which is alike, every seventh byte will do.
  for (size_t i = 0; i < log.size(); i += i < 1000 || i + 1000 > log.size() ? 1 : 7) {
    std::string altered = log;
    altered[i] = static_cast<char>(altered[i] ^ (1 << (i % 8)));
    const auto parsed = ParseEpisodeLog(altered);
    ASSERT_FALSE(parsed.ok()) << "byte " << i;
  }
}

TEST(EpisodeLog, NoneCanBeCutOrMadeLonger) {
  const std::string log = Log(2);
  for (size_t size = 0; size < log.size(); size += size < 100 ? 1 : 37) {
    EXPECT_FALSE(ParseEpisodeLog(std::string_view(log).substr(0, size)).ok()) << size;
  }
  EXPECT_FALSE(ParseEpisodeLog(log + log).ok());
  EXPECT_FALSE(ParseEpisodeLog(log + "x").ok());
}

TEST(EpisodeLog, AnAlteredActionIsNamedAsSuch) {
  std::string log = Log(2);
  const size_t action = log.find(kActionChannel) + kActionChannel.size() + 40;
  log[action] = static_cast<char>(log[action] ^ 1);
  EXPECT_THAT(std::string(ParseEpisodeLog(log).status().message()), HasSubstr("checksum"));
}

TEST(EpisodeLog, NoiseIsAnErrorAndNeverACrash) {
  EXPECT_TRUE(rc::check([](const std::string& noise) { RC_ASSERT(!ParseEpisodeLog(noise).ok()); }));
  EXPECT_TRUE(rc::check([] {
    static const std::string log = Log(1);
    std::string altered = log;
    const auto place = *rc::gen::inRange<size_t>(0, log.size());
    const auto size = *rc::gen::inRange<size_t>(0, 64);
    const std::string patch = *rc::gen::container<std::string>(rc::gen::arbitrary<char>());
    altered.replace(place, size, patch);
    if (altered != log) RC_ASSERT(!ParseEpisodeLog(altered).ok());
  }));
}

TEST(EpisodeLog, HeadsThatClaimTooMuchAreRefused) {
  std::string log;
  AppendEvent(0, 0, kActionChannel, {}, log);
  for (const size_t field : {20u, 24u}) {  // lengths of the name and of the message
    std::string claims = log;
    claims.replace(field, 4, "\xff\xff\xff\xff");
    EventLogReader reader(claims);
    EXPECT_FALSE(reader.Next().ok());
  }
}

}  // namespace
}  // namespace myograde
