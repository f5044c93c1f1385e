// The registry of the simulated tracks, and the rules of all configs that there are.
#include "sim/tracks.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "protocol/tracks/registry.h"

namespace myograde::sim {
namespace {

// The simulator reads the rules before it looks for the model, which is not there.
void ExpectRulesAreRead(const TrackConfig& config) {
  const absl::Status status = MakeEnvironment(config, "/nowhere").status();
  EXPECT_TRUE(absl::IsNotFound(status)) << config.id << ", " << config.profile << ": " << status;
}

TEST(SimulatedTracks, EveryTrackOfTheProtocolIsSimulated) {
  ASSERT_EQ(SimulatedTracks().size(), AllTracks().size());
  for (size_t i = 0; i < AllTracks().size(); ++i) {
    EXPECT_EQ(SimulatedTracks()[i].kind, AllTracks()[i]);
    EXPECT_EQ(SimulatedTracks()[i].model->name, AllTracks()[i]->name);
  }
}

TEST(SimulatedTracks, RulesOfEveryShippedConfigAreRead) {
  const std::string folder = MYOGRADE_SOURCE_DIR "/configs/tracks";
  const auto tracks = ListTracks(folder);
  ASSERT_TRUE(tracks.ok()) << tracks.status();
  for (const std::string& track : *tracks) {
    const auto profiles = LoadProfiles(folder, track);
    ASSERT_TRUE(profiles.ok()) << profiles.status();
    for (const auto& [profile, config] : profiles->configs) ExpectRulesAreRead(config);
  }
}

}  // namespace
}  // namespace myograde::sim
