// Decodes a policy's messages into frames. LCM's generated decoders trust counts and lengths, so
// each message's fingerprint and exact length are checked on the raw bytes before such a decoder
// runs.
#pragma once

#include <cstddef>
#include <span>

#include <absl/status/status.h>

#include "myograde/action_t.hpp"
#include "protocol/bridge/frames.h"

namespace myograde::bridge {

// Each fills the body of a frame (not its header). InvalidArgumentError: one sentence for the
// policy's author, without the channel's name.
absl::Status DecodeHello(std::span<const std::byte> payload, HelloFrame& frame);
absl::Status DecodeReady(std::span<const std::byte> payload, ReadyFrame& frame);

// Expects `action_size` finite entries (any number up to kMaxActionSize if 0). `scratch` saves an
// allocation per message.
absl::Status DecodeAction(std::span<const std::byte> payload, uint32_t action_size,
                          action_t& scratch, ActionFrame& frame);

absl::Status DecodeGiveUp(std::span<const std::byte> payload, GiveUpFrame& frame);

}  // namespace myograde::bridge
