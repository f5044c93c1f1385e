// Frames from the participant's sandbox: whatever is accepted has counts, enums, numbers and text
// that the simulator can rely on.
#include <cmath>
#include <cstring>

#include "protocol/base/config_reader.h"
#include "protocol/bridge/frames.h"
#include "protocol/bridge/leg_sets_json.h"
#include "tests/fuzz/fuzz.h"

namespace {

using namespace myograde;
using fuzz::Require;

// As the track reads them.
void CheckParameters(const ParametersText& parameters) {
  Require(parameters.size <= kMaxParameterBytes, "the parameters fit");
  const auto json = ParseJson({parameters.text, parameters.size}, "parameters");
  if (!json.ok()) return;
  const absl::StatusOr<LegParameterSets> sets = LegSetsFromJson(*json);
  if (!sets.ok()) {
    Require(!sets.status().message().empty(), "a refusal says why");
    return;
  }
  Require(sets->present < (1u << kLegSets), "only known sets are present");
  for (int i = 0; i < kLegSets; ++i) {
    if ((sets->present >> i & 1u) == 0) continue;
    for (const LegStateParameters& state : sets->set[i]) {
      Require(std::isfinite(state.knee_stiffness) && std::isfinite(state.knee_damping) &&
                  std::isfinite(state.knee_target) && std::isfinite(state.ankle_stiffness) &&
                  std::isfinite(state.ankle_damping) && std::isfinite(state.ankle_target),
              "leg parameters are finite");
      for (int k = 0; k < kLegQuantities; ++k) {
        Require(state.threshold_kind[k] <= 2, "thresholds are of a known kind");
        Require(std::isfinite(state.threshold[k]), "thresholds are finite");
      }
    }
  }
  const auto again = LegSetsFromJson(LegSetsToJson(*sets));
  Require(again.ok() && LegSetsToJson(*again) == LegSetsToJson(*sets), "sets keep their values");
}

struct Checker {
  void operator()(const HelloFrame& frame) const {
    Require(frame.convention <= ActionConvention::kDirect, "the convention is known");
    CheckParameters(frame.parameters);
  }
  void operator()(const ReadyFrame& frame) const {
    Require(frame.episode >= 0, "the episode is not negative");
    CheckParameters(frame.parameters);
  }
  void operator()(const ActionFrame& frame) const {
    Require(frame.episode >= 0 && frame.step >= 0, "episode and step are not negative");
    Require(frame.size <= static_cast<uint32_t>(kMaxActionSize), "the action fits");
    for (uint32_t i = 0; i < frame.size; ++i) {
      Require(std::isfinite(frame.values[i]), "the action is finite");
    }
  }
  void operator()(const GiveUpFrame& frame) const {
    Require(frame.episode >= 0 && frame.step >= 0, "episode and step are not negative");
  }
  void operator()(const FaultFrame& frame) const {
    Require(frame.fault >= BridgeFault::kProtocol && frame.fault <= BridgeFault::kStartFailed,
            "the fault is known");
    Require(strnlen(frame.detail, sizeof(frame.detail)) < sizeof(frame.detail),
            "the text has an end");
    for (const char* c = frame.detail; *c != '\0'; ++c) {
      Require(*c >= ' ' && *c <= '~', "the text is printable");
    }
  }
};

void Check(std::span<const std::byte> bytes) {
  const absl::StatusOr<BridgeFrame> frame = ParseBridgeFrame(bytes);
  if (!frame.ok()) {
    Require(!frame.status().message().empty(), "a refusal says why");
    return;
  }
  std::visit(Checker(), *frame);
}

// The same bytes with a header that is valid for one of the types.
template <typename F>
void CheckAs(FrameType type, std::span<const std::byte> body) {
  F frame = {};
  const FrameHeader header = MakeHeader<F>(type);
  auto* bytes = reinterpret_cast<std::byte*>(&frame);
  std::memcpy(bytes, &header, sizeof(header));
  std::memcpy(bytes + sizeof(header), body.data(),
              std::min(body.size(), sizeof(F) - sizeof(header)));
  Check({bytes, sizeof(F)});
}

}  // namespace

// The first byte chooses: raw bytes, or the body of a frame of one type.
MYOGRADE_FUZZ_TARGET(frame)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const uint8_t kind = input.Byte();
  const auto rest = input.Rest();
  switch (kind % 6) {
    case 0:
      Check(rest);
      break;
    case 1:
      CheckAs<HelloFrame>(FrameType::kHello, rest);
      break;
    case 2:
      CheckAs<ReadyFrame>(FrameType::kReady, rest);
      break;
    case 3:
      CheckAs<ActionFrame>(FrameType::kAction, rest);
      break;
    case 4:
      CheckAs<GiveUpFrame>(FrameType::kGiveUp, rest);
      break;
    default:
      CheckAs<FaultFrame>(FrameType::kFault, rest);
      break;
  }
  return 0;
}
