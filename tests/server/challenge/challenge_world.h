// Challenge files and what they are checked against.
#pragma once

#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "server/challenge/challenge.h"
#include "server/challenge/offered_tracks.h"

namespace myograde::server {

// Their own seeds are 0 to 99.
inline constexpr char kArm[] = "manipulation";
inline constexpr char kLeg[] = "locomotion";
inline constexpr char kProfile[] = "paper";

inline const Tracks& ShippedTracks() {
  static const Tracks tracks = *Tracks::Load(MYOGRADE_SOURCE_DIR "/configs/tracks");
  return tracks;
}

// A phase with the keys that each needs, and `more`.
inline nlohmann::json PhaseJson(const std::string& name, const nlohmann::json& more = {}) {
  nlohmann::json phase = {
      {"name", name}, {"title", "A phase"}, {"track", kArm}, {"profile", kProfile}};
  if (more.is_object()) phase.update(more);
  return phase;
}

inline nlohmann::json ChallengeJson(const std::vector<nlohmann::json>& phases) {
  return {{"form", 1}, {"title", "A cup"}, {"phases", phases}};
}

// Reads a challenge file. InvalidArgumentError is its mistakes.
inline absl::StatusOr<ChallengeConfig> ParseChallenge(const nlohmann::json& json,
                                                      const std::string& name,
                                                      const std::string& where) {
  std::vector<std::string> mistakes;
  ChallengeConfig challenge = ReadChallenge(json, name, where, mistakes);
  if (!mistakes.empty()) return MistakesToStatus(mistakes);
  return challenge;
}

// Of a file without a mistake.
inline ChallengeConfig ChallengeOf(const std::vector<nlohmann::json>& phases,
                                   const std::string& name = "cup") {
  absl::StatusOr<ChallengeConfig> challenge =
      ParseChallenge(ChallengeJson(phases), name, name + ".json");
  EXPECT_TRUE(challenge.ok()) << challenge.status();
  return challenge.value_or(ChallengeConfig());
}

inline absl::Time At(const std::string& text) {
  absl::Time time;
  std::string error;
  EXPECT_TRUE(absl::ParseTime(absl::RFC3339_full, text, &time, &error)) << error;
  return time;
}

}  // namespace myograde::server
