// A policy's messages for tests of the bridge.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <vector>

#include "myograde/action_t.hpp"
#include "myograde/episode_ready_t.hpp"
#include "myograde/give_up_t.hpp"
#include "myograde/hello_t.hpp"
#include "protocol/bridge/datagram.h"
#include "protocol/bridge/frames.h"

namespace myograde {

using Packet = std::vector<std::byte>;

template <typename Message>
Packet Encode(const Message& message) {
  Packet bytes(static_cast<size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

// A datagram with an encoded message, or any other payload, on a channel.
inline Packet Wrap(std::string_view channel, const Packet& payload, uint32_t sequence = 1) {
  std::array<std::byte, kDatagramHeader + kMaxChannelLength + 1> head;
  const size_t size = WriteDatagramHead(sequence, channel, head);
  Packet packet(head.begin(), head.begin() + static_cast<std::ptrdiff_t>(size));
  packet.insert(packet.end(), payload.begin(), payload.end());
  return packet;
}

inline hello_t GoodHello() {
  hello_t hello;
  hello.protocol_version = 1;
  hello.name = "test";
  hello.direct = 0;
  hello.num_leg_sets = 0;
  return hello;
}

inline episode_ready_t GoodReady(int64_t episode) {
  episode_ready_t ready;
  ready.episode = episode;
  ready.num_leg_sets = 0;
  return ready;
}

inline action_t GoodAction(int64_t episode, int64_t step, int size = 55) {
  action_t action;
  action.episode = episode;
  action.step = step;
  action.size = size;
  action.values.assign(static_cast<size_t>(size), 0.25);
  return action;
}

inline give_up_t GivingUp(int64_t episode, int64_t step) {
  give_up_t give_up;
  give_up.episode = episode;
  give_up.step = step;
  return give_up;
}

// The simulator's question, without a payload. Observations expect 55 entries.
inline PublishFrame Question(Channel channel, Expect expect, int64_t episode, int64_t step) {
  PublishFrame frame;
  std::memset(&frame, 0, offsetof(PublishFrame, payload));
  frame.channel = channel;
  frame.expect = expect;
  frame.episode = episode;
  frame.step = step;
  frame.action_size = channel == Channel::kObservation ? 55 : 0;
  return frame;
}

}  // namespace myograde
