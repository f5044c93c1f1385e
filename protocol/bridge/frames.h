// The messages between simulator and bridge over an inherited SOCK_SEQPACKET socket pair: one frame
// per packet, plain little-endian structs of fixed size. The bridge lives in the participant's
// sandbox, so the simulator checks every field that it receives (ParseBridgeFrame).
//
//   sim -> bridge   PublishFrame: an encoded LCM message to put on the bus, and
//                   which answer to wait for. The bridge resends it until
//                   the answer arrives.
//   bridge -> sim   HelloFrame, ReadyFrame, ActionFrame, GiveUpFrame, FaultFrame
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

#include <absl/status/statusor.h>

#include "protocol/policy/layout.h"
#include "protocol/tracks/episode_facts.h"

namespace myograde {

inline constexpr uint32_t kFrameMagic = 0x4d794f47;  // "MyOG"
inline constexpr uint32_t kFrameVersion = 1;
inline constexpr size_t kMaxPublishBytes = 60000;
inline constexpr size_t kMaxParameterBytes = 8184;

enum class FrameType : uint32_t {
  kPublish = 1,
  kHello = 2,
  kReady = 3,
  kAction = 4,
  kFault = 5,
  kGiveUp = 6,
};

struct FrameHeader {
  uint32_t magic;
  uint32_t version;
  FrameType type;
  uint32_t size;  // bytes of the whole frame
};

// The answer that a published message waits for. kAction: an action, or a give-up.
enum class Expect : uint32_t { kNothing = 0, kHello = 1, kReady = 2, kAction = 3 };

// The channel a message goes out on.
enum class Channel : uint32_t {
  kWelcome = 0,
  kEpisodeStart = 1,
  kObservation = 2,
  kEpisodeEnd = 3,
};

// sim -> bridge; `payload` has `payload_size` bytes of encoded LCM message.
struct PublishFrame {
  FrameHeader header;
  Channel channel;
  Expect expect;
  int64_t episode;      // position in the lease, from 0
  int64_t step;         // -1 if it has no step
  uint32_t action_size;  // required entries of the action (Expect::kAction)
  uint32_t payload_size;
  std::byte payload[kMaxPublishBytes];
};

// Parameters that the policy uploads, as JSON that only the track reads; none: `size` is 0.
struct ParametersText {
  uint32_t size;
  uint32_t padding;
  char text[kMaxParameterBytes];
};

// bridge -> sim: the policy said hello.
struct HelloFrame {
  FrameHeader header;
  uint32_t protocol_version;
  ActionConvention convention;
  ParametersText parameters;
};

// bridge -> sim: the policy is ready for the episode.
struct ReadyFrame {
  FrameHeader header;
  int64_t episode;
  ParametersText parameters;
};

// bridge -> sim: values[0, size) answer the observation of (episode, step).
struct ActionFrame {
  FrameHeader header;
  int64_t episode;
  int64_t step;
  uint32_t size;
  uint32_t padding;
  double values[kMaxActionSize];
};

// bridge -> sim: the policy answers the observation of (episode, step) by giving the episode up.
struct GiveUpFrame {
  FrameHeader header;
  int64_t episode;
  int64_t step;
};

enum class BridgeFault : uint32_t {
  kProtocol = 1,     // `detail` says what was wrong
  kPolicyExit = 2,   // `value`: wait status of the policy's process
  kStrayLimit = 3,   // `value`: messages counted
  kStartFailed = 4,  // the policy's command could not be started; `value`: errno
};

struct FaultFrame {
  FrameHeader header;
  BridgeFault fault;
  uint32_t padding;
  int64_t value;
  char detail[240];  // printable ASCII, NUL-terminated
};

using BridgeFrame = std::variant<HelloFrame, ReadyFrame, ActionFrame, GiveUpFrame, FaultFrame>;

// Checks magic, version, type, size, counts, enums, finiteness of numbers and printability of text.
// REQUIRES nothing of `bytes`: they come from the participant's sandbox.
absl::StatusOr<BridgeFrame> ParseBridgeFrame(std::span<const std::byte> bytes);

// Fills a header for a frame of type F.
template <typename F>
FrameHeader MakeHeader(FrameType type, size_t size = sizeof(F)) {
  return {kFrameMagic, kFrameVersion, type, static_cast<uint32_t>(size)};
}

}  // namespace myograde
