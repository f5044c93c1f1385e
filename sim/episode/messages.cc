#include "sim/episode/messages.h"

#include <cstddef>
#include <cstdlib>
#include <vector>

#include "myograde/episode_end_t.hpp"
#include "myograde/episode_start_t.hpp"
#include "myograde/welcome_t.hpp"
#include "protocol/policy/channels.h"
#include "protocol/policy/layout.h"

namespace myograde::sim {
namespace {

constexpr size_t kHead = offsetof(PublishFrame, payload);

// Adds the parts of a vector that begins at entry `first` of the whole.
void AddParts(const VectorLayout& layout, int first, std::vector<part_t>& parts) {
  for (const Part& part : layout.parts()) {
    parts.push_back({});
    parts.back().name = part.name;
    parts.back().offset = first + part.offset;
    parts.back().size = part.size;
    parts.back().unit = part.unit;
  }
}

void Split(std::span<const Bounds> bounds, std::vector<double>& low,
           std::vector<double>& high) {
  for (const Bounds& bound : bounds) {
    low.push_back(bound.low);
    high.push_back(bound.high);
  }
}

// Appends entries to what the welcome says of observations.
void AddObservation(const VectorLayout& layout, welcome_t& message) {
  AddParts(layout, message.observation_size, message.observation_parts);
  message.num_observation_parts = static_cast<int32_t>(message.observation_parts.size());
  message.observation_size += layout.size();
  Split(layout.bounds(), message.observation_low, message.observation_high);
}

}  // namespace

Messages::Messages() : frame_(std::make_unique<PublishFrame>()) {}

template <typename Message>
const PublishFrame& Messages::Fill(Channel channel, Expect expect, int64_t episode, int64_t step,
                                   uint32_t action_size, const Message& message) {
  const int size = message.encode(frame_->payload, 0, static_cast<int>(kMaxPublishBytes));
  if (size < 0) std::abort();  // the layouts are fixed, and the largest fits
  frame_->channel = channel;
  frame_->expect = expect;
  frame_->episode = episode;
  frame_->step = step;
  frame_->action_size = action_size;
  frame_->payload_size = static_cast<uint32_t>(size);
  frame_->header = MakeHeader<PublishFrame>(FrameType::kPublish, kHead + frame_->payload_size);
  return *frame_;
}

const PublishFrame& Messages::Welcome(const TrackConfig& track, const WelcomeInfo& info) {
  welcome_t message;
  message.protocol_version = kProtocolVersion;
  message.accepted = info.accepted ? 1 : 0;
  message.reason = info.reason;
  message.track = track.kind->name;
  message.profile = track.profile;
  message.direct = info.convention == ActionConvention::kDirect ? 1 : 0;
  message.control_period_s = track.kind->control_period_s;
  message.max_steps = static_cast<int32_t>(info.max_steps);
  message.step_budget_s = track.budgets.step_s;
  message.overtime_s = track.budgets.overtime_s;
  message.observation_size = 0;
  AddObservation(ObservationOf(*track.kind), message);
  if (info.extra_observations) AddObservation(ExtraOf(*track.kind), message);
  AddParts(ActionOf(*track.kind), 0, message.action_parts);
  message.num_action_parts = static_cast<int32_t>(message.action_parts.size());
  message.action_size = ActionOf(*track.kind).size();
  Split(track.kind->layout().action_bounds(info.convention), message.action_low, message.action_high);
  return Fill(Channel::kWelcome, Expect::kNothing, -1, -1, 0, message);
}

const PublishFrame& Messages::EpisodeStart(int64_t episode, uint64_t policy_seed) {
  episode_start_t message;
  message.episode = episode;
  message.policy_seed = static_cast<int64_t>(policy_seed);
  return Fill(Channel::kEpisodeStart, Expect::kReady, episode, -1, 0, message);
}

std::span<double> Messages::ObservationValues(int size) {
  observation_.size = size;
  observation_.values.resize(static_cast<size_t>(size));
  return observation_.values;
}

const PublishFrame& Messages::Observation(int64_t episode, int64_t step, uint32_t action_size) {
  observation_.episode = episode;
  observation_.step = step;
  return Fill(Channel::kObservation, Expect::kAction, episode, step, action_size, observation_);
}

const PublishFrame& Messages::EpisodeEnd(int64_t episode, int64_t steps) {
  episode_end_t message;
  message.episode = episode;
  message.steps = steps;
  return Fill(Channel::kEpisodeEnd, Expect::kNothing, episode, -1, 0, message);
}

std::span<const std::byte> FrameBytes(const PublishFrame& frame) {
  return {reinterpret_cast<const std::byte*>(&frame), kHead + frame.payload_size};
}

}  // namespace myograde::sim
