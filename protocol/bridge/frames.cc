#include "protocol/bridge/frames.h"

#include <cmath>
#include <cstring>
#include <type_traits>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

// Frames cross a process boundary as raw bytes.
static_assert(std::is_trivially_copyable_v<HelloFrame> && sizeof(FrameHeader) == 16);
static_assert(std::is_trivially_copyable_v<ActionFrame> &&
              sizeof(ActionFrame) == 16 + 8 + 8 + 4 + 4 + 8 * kMaxActionSize);
static_assert(std::is_trivially_copyable_v<FaultFrame> && sizeof(FaultFrame) == 16 + 16 + 240);
static_assert(std::is_trivially_copyable_v<GiveUpFrame> && sizeof(GiveUpFrame) == 16 + 16);

absl::Status Wrong(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("the bridge sent a broken frame: ", what));
}

absl::Status CheckParameters(const ParametersText& parameters) {
  if (parameters.size <= kMaxParameterBytes) return absl::OkStatus();
  return Wrong("its parameters are too long");
}

absl::Status Check(const HelloFrame& frame) {
  if (frame.convention != ActionConvention::kNormalized &&
      frame.convention != ActionConvention::kDirect) {
    return Wrong("its action convention is unknown");
  }
  return CheckParameters(frame.parameters);
}

absl::Status Check(const ReadyFrame& frame) {
  if (frame.episode < 0) return Wrong("its episode is negative");
  return CheckParameters(frame.parameters);
}

absl::Status Check(const ActionFrame& frame) {
  if (frame.episode < 0 || frame.step < 0) return Wrong("its episode or step is negative");
  if (frame.size > kMaxActionSize) return Wrong("its action is too long");
  for (uint32_t i = 0; i < frame.size; ++i) {
    if (!std::isfinite(frame.values[i])) return Wrong("its action is not finite");
  }
  return absl::OkStatus();
}

absl::Status Check(const GiveUpFrame& frame) {
  if (frame.episode < 0 || frame.step < 0) return Wrong("its episode or step is negative");
  return absl::OkStatus();
}

absl::Status Check(const FaultFrame& frame) {
  if (frame.fault < BridgeFault::kProtocol || frame.fault > BridgeFault::kStartFailed) {
    return Wrong("its fault is unknown");
  }
  const void* end = std::memchr(frame.detail, '\0', sizeof(frame.detail));
  if (end == nullptr) return Wrong("its text has no end");
  for (const char* c = frame.detail; *c != '\0'; ++c) {
    if (*c < ' ' || *c > '~') return Wrong("its text is not printable");
  }
  return absl::OkStatus();
}

template <typename F>
absl::StatusOr<BridgeFrame> Parse(std::span<const std::byte> bytes) {
  if (bytes.size() != sizeof(F)) return Wrong("its size is wrong for its type");
  F frame;
  std::memcpy(&frame, bytes.data(), sizeof(F));
  RETURN_IF_ERROR(Check(frame));
  return BridgeFrame(frame);
}

}  // namespace

absl::StatusOr<BridgeFrame> ParseBridgeFrame(std::span<const std::byte> bytes) {
  FrameHeader header;
  if (bytes.size() < sizeof(header)) return Wrong("it is shorter than a header");
  std::memcpy(&header, bytes.data(), sizeof(header));
  if (header.magic != kFrameMagic) return Wrong("its magic number is wrong");
  if (header.version != kFrameVersion) return Wrong("its version is wrong");
  if (header.size != bytes.size()) return Wrong("its size is not the size of the packet");
  switch (header.type) {
    case FrameType::kHello:
      return Parse<HelloFrame>(bytes);
    case FrameType::kReady:
      return Parse<ReadyFrame>(bytes);
    case FrameType::kAction:
      return Parse<ActionFrame>(bytes);
    case FrameType::kGiveUp:
      return Parse<GiveUpFrame>(bytes);
    case FrameType::kFault:
      return Parse<FaultFrame>(bytes);
    default:
      return Wrong("its type is unknown");
  }
}

}  // namespace myograde
