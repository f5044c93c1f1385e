// A policy's LCM messages: hello, ready, action and give-up. An accepted message becomes a frame
// that the simulator accepts, and LCM encodes it to the same bytes again.
#include <cstring>
#include <vector>

#include "myograde/action_t.hpp"
#include "myograde/episode_ready_t.hpp"
#include "myograde/give_up_t.hpp"
#include "myograde/hello_t.hpp"
#include "protocol/bridge/decode.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

using Payload = std::vector<std::byte>;

template <typename Message>
Payload WithFingerprint(std::span<const std::byte> body) {
  Payload payload;
  const auto hash = static_cast<uint64_t>(Message::getHash());
  for (int i = 7; i >= 0; --i) payload.push_back(static_cast<std::byte>(hash >> (8 * i)));
  payload.insert(payload.end(), body.begin(), body.end());
  return payload;
}

template <typename F>
void CheckFrame(F& frame, FrameType type) {
  frame.header = MakeHeader<F>(type);
  const auto parsed = ParseBridgeFrame(std::as_bytes(std::span<const F, 1>(&frame, 1)));
  Require(parsed.ok(), "what the bridge accepts, the simulator takes");
}

template <typename Message>
Message CheckRoundTrip(const Payload& payload) {
  Message message;
  const int size = static_cast<int>(payload.size());
  Require(message.decode(payload.data(), 0, size) == size, "LCM reads the whole message");
  if constexpr (!std::is_same_v<Message, hello_t>) {  // a name may contain a NUL anywhere
    Payload again(static_cast<size_t>(message.getEncodedSize()));
    Require(message.encode(again.data(), 0, static_cast<int>(again.size())) == size &&
                again == payload, "LCM writes the same message again");
  }
  return message;
}

void CheckHello(const Payload& payload) {
  HelloFrame frame = {};
  if (!bridge::DecodeHello(payload, frame).ok()) return;
  const hello_t message = CheckRoundTrip<hello_t>(payload);
  Require(message.name.size() <= 64, "a name is short");
  CheckFrame(frame, FrameType::kHello);
}

void CheckReady(const Payload& payload) {
  ReadyFrame frame = {};
  if (!bridge::DecodeReady(payload, frame).ok()) return;
  CheckRoundTrip<episode_ready_t>(payload);
  if (frame.episode >= 0) CheckFrame(frame, FrameType::kReady);
}

void CheckAction(uint32_t wanted, const Payload& payload) {
  ActionFrame frame = {};
  action_t scratch;
  if (!bridge::DecodeAction(payload, wanted, scratch, frame).ok()) return;
  CheckRoundTrip<action_t>(payload);
  Require(wanted == 0 || frame.size == wanted, "an action has the size that was asked for");
  if (frame.episode >= 0 && frame.step >= 0) CheckFrame(frame, FrameType::kAction);
}

void CheckGiveUp(const Payload& payload) {
  GiveUpFrame frame = {};
  if (!bridge::DecodeGiveUp(payload, frame).ok()) return;
  CheckRoundTrip<give_up_t>(payload);
  if (frame.episode >= 0 && frame.step >= 0) CheckFrame(frame, FrameType::kGiveUp);
}

}  // namespace

// The first byte: bits 0-1 the message, bit 2 whether to prepend the fingerprint, bits 3-7 the
// expected size of the action.
MYOGRADE_FUZZ_TARGET(decode)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const uint8_t choice = input.Byte();
  const auto rest = input.Rest();
  const bool help = (choice & 4) != 0;
  const Payload raw(rest.begin(), rest.end());
  switch (choice & 3) {
    case 0:
      CheckHello(help ? WithFingerprint<hello_t>(rest) : raw);
      break;
    case 1:
      CheckReady(help ? WithFingerprint<episode_ready_t>(rest) : raw);
      break;
    case 3:
      CheckGiveUp(help ? WithFingerprint<give_up_t>(rest) : raw);
      break;
    default:
      CheckAction(choice >> 3, help ? WithFingerprint<action_t>(rest) : raw);
      break;
  }
  return 0;
}
