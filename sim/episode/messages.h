// The grader's messages, encoded for the bus inside frames for the bridge.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "myograde/observation_t.hpp"
#include "protocol/bridge/frames.h"
#include "protocol/lease/track_config.h"

namespace myograde::sim {

// What a welcome tells beyond the track config.
struct WelcomeInfo {
  bool accepted = true;
  std::string reason;  // if refused: why
  ActionConvention convention = ActionConvention::kNormalized;
  int64_t max_steps = 0;
  bool extra_observations = false;  // observations end with the entries of TrackLayout::extra
};

// Fills one frame after the other; every call returns the same frame, valid
// until the next. One per simulator. Nothing is allocated for observations
// after the first.
class Messages {
 public:
  Messages();

  const PublishFrame& Welcome(const TrackConfig& track, const WelcomeInfo& info);
  const PublishFrame& EpisodeStart(int64_t episode, uint64_t policy_seed);
  // Room for the values of the next observation.
  std::span<double> ObservationValues(int size);
  // Takes the values from there.
  const PublishFrame& Observation(int64_t episode, int64_t step, uint32_t action_size);
  const PublishFrame& EpisodeEnd(int64_t episode, int64_t steps);

 private:
  template <typename Message>
  const PublishFrame& Fill(Channel channel, Expect expect, int64_t episode, int64_t step,
                           uint32_t action_size, const Message& message);

  std::unique_ptr<PublishFrame> frame_;
  observation_t observation_;
};

// Bytes of `frame` that are sent: its head and the used part of its payload.
std::span<const std::byte> FrameBytes(const PublishFrame& frame);

}  // namespace myograde::sim
