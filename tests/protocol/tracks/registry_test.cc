#include "protocol/tracks/registry.h"

#include <algorithm>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/lease.h"

namespace myograde {
namespace {

TEST(Tracks, EachIsFoundByItsNameAndNoOtherIs) {
  std::set<std::string> names;
  for (const TrackKind* track : AllTracks()) {
    EXPECT_EQ(FindTrack(track->name), track);
    EXPECT_TRUE(names.emplace(track->name).second) << track->name;
    EXPECT_GT(track->control_period_s, 0);
  }
  EXPECT_EQ(FindTrack(""), nullptr);
  EXPECT_EQ(FindTrack("none"), nullptr);
}

TEST(Tracks, LayoutsHaveNoGapsAndActionsFitTheirFrame) {
  for (const TrackKind* track : AllTracks()) {
    SCOPED_TRACE(track->name);
    for (const VectorLayout* vector :
         {&ObservationOf(*track), &ExtraOf(*track), &ActionOf(*track)}) {
      int offset = 0;
      for (const Part& part : vector->parts()) {
        EXPECT_EQ(part.offset, offset) << part.name;
        offset += part.size;
      }
      EXPECT_EQ(vector->size(), offset);
      EXPECT_EQ(std::set(vector->names().begin(), vector->names().end()).size(),
                vector->names().size());
      for (const Bounds& bounds : vector->bounds()) EXPECT_LT(bounds.low, bounds.high);
    }
    // On the wire the extra parts stand behind the others, and a name means one part.
    for (const Part& part : ExtraOf(*track).parts()) {
      EXPECT_TRUE(std::ranges::none_of(
          ObservationOf(*track).parts(),
          [&](const Part& graded) { return graded.name == part.name; })) << part.name;
    }
    EXPECT_LE(ActionOf(*track).size(), kMaxActionSize);
    EXPECT_EQ(std::visit([](const auto& facts) { return facts.kActionSize; }, track->no_facts),
              ActionOf(*track).size());
    EXPECT_EQ(std::ssize(track->layout().direct_bounds), ActionOf(*track).size());
  }
}

template <typename... Facts, typename... Details>
bool SameOrder(std::variant<Facts...>*, std::variant<Details...>*) {
  return sizeof...(Facts) == sizeof...(Details) && ((Facts::kTrack == Details::kTrack) && ...);
}

TEST(Tracks, EachHasDetailsInThePlaceOfItsFacts) {
  EXPECT_TRUE(SameOrder(static_cast<TrackFacts*>(nullptr), static_cast<TrackDetails*>(nullptr)));
}

TEST(Tracks, FactsKeepTheirTrackInRecords) {
  for (const TrackKind* track : AllTracks()) {
    SCOPED_TRACE(track->name);
    EXPECT_TRUE(AreFactsOf(*track, track->no_facts));
    EpisodeFacts facts;
    facts.track = track->no_facts;
    const auto read = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_TRUE(AreFactsOf(*track, read->track));
    EXPECT_EQ(EpisodeFactsToJson(facts)["track"], track->name);
  }
}

TEST(Tracks, WordsOfAllTracksAreRead) {
  for (const char* word : {"", "time", "given-up", "dropped", "force", "handover", "contact",
                           "phantom", "fell", "off-track", "caught", "out-of-bounds"}) {
    const auto reason = ParseFailureReason(word);
    ASSERT_TRUE(reason.has_value()) << word;
    EXPECT_EQ(reason->name(), word);
  }
  for (const char* word : {"time", "given-up", "fault", "placed", "dropped", "phantom", "finished",
                           "fell", "off-track", "tagged", "caught", "out-of-bounds"}) {
    ASSERT_TRUE(ParseEpisodeEnd(word).has_value()) << word;
    EXPECT_EQ(ParseEpisodeEnd(word)->name(), word);
  }
  EXPECT_EQ(ParseFailureReason("won"), std::nullopt);
  EXPECT_EQ(ParseEpisodeEnd(""), std::nullopt);
}

}  // namespace
}  // namespace myograde
