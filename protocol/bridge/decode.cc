#include "protocol/bridge/decode.h"

#include <cmath>
#include <cstring>
#include <string>

#include <absl/strings/str_cat.h>

#include "myograde/episode_ready_t.hpp"
#include "myograde/give_up_t.hpp"
#include "myograde/hello_t.hpp"
#include "protocol/base/status_macros.h"
#include "protocol/bridge/leg_sets_json.h"

namespace myograde::bridge {
namespace {

constexpr int32_t kMaxName = 64;  // maximum bytes of a policy's name, see myograde.lcm

absl::Status Malformed(absl::string_view what) {
  return absl::InvalidArgumentError(what);
}

// Reads encoded bytes without copying. After the first read past the end every read returns 0 and
// ok() stays false.
class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> bytes) : rest_(bytes) {}

  bool ok() const { return ok_; }
  bool at_end() const { return ok_ && rest_.empty(); }

  bool Skip(size_t size) {
    ok_ = ok_ && size <= rest_.size();
    rest_ = ok_ ? rest_.subspan(size) : std::span<const std::byte>();
    return ok_;
  }

  uint64_t Unsigned(size_t size) {
    const std::byte* from = rest_.data();
    if (!Skip(size)) return 0;
    uint64_t value = 0;
    for (size_t i = 0; i < size; ++i) value = value << 8 | std::to_integer<uint64_t>(from[i]);
    return value;
  }

  int32_t Int32() { return static_cast<int32_t>(Unsigned(4)); }

 private:
  std::span<const std::byte> rest_;
  bool ok_ = true;
};

template <typename Message>
bool FingerprintFits(Cursor& cursor) {
  return cursor.Unsigned(8) == static_cast<uint64_t>(Message::getHash()) && cursor.ok();
}

absl::Status WrongFingerprint(absl::string_view type) {
  return Malformed(absl::StrCat("the message is not a ", type,
                                " of this protocol version (its LCM fingerprint differs)"));
}

// Checks counts and lengths of an array of leg_parameter_set_t.
absl::Status WalkLegSets(Cursor& cursor) {
  const int32_t sets = cursor.Int32();
  if (sets < 0 || sets > kLegSets) {
    return Malformed(absl::StrCat("num_leg_sets is ", sets, ", must be 0 to ", kLegSets));
  }
  for (int32_t set = 0; set < sets; ++set) {
    cursor.Skip(1);
    for (int state = 0; state < kLegStates; ++state) {
      cursor.Skip(6 * sizeof(double));
      const int32_t thresholds = cursor.Int32();
      if (!cursor.ok()) return Malformed("the message ends inside a leg parameter set");
      if (thresholds < 1 || thresholds > kLegQuantities) {
        return Malformed(absl::StrCat("num_thresholds is ", thresholds, ", must be 1 to ",
                                      kLegQuantities));
      }
      cursor.Skip(static_cast<size_t>(thresholds) * (1 + 1 + sizeof(double)));
    }
  }
  return absl::OkStatus();
}

absl::Status WalkEnd(const Cursor& cursor) {
  if (!cursor.ok()) return Malformed("the message ends too early");
  if (!cursor.at_end()) return Malformed("the message has bytes after its end");
  return absl::OkStatus();
}

// Names a leg set and state in messages.
std::string Place(int set, int state) { return absl::StrCat("leg set ", set, ", state ", state); }

absl::Status ConvertState(const leg_state_t& from, const std::string& place,
                          LegStateParameters& to) {
  to = {};
  to.knee_stiffness = from.knee_stiffness;
  to.knee_damping = from.knee_damping;
  to.knee_target = from.knee_target;
  to.ankle_stiffness = from.ankle_stiffness;
  to.ankle_damping = from.ankle_damping;
  to.ankle_target = from.ankle_target;
  for (const double number : {to.knee_stiffness, to.knee_damping, to.knee_target,
                              to.ankle_stiffness, to.ankle_damping, to.ankle_target}) {
    if (!std::isfinite(number)) return Malformed(absl::StrCat(place, ": a number is not finite"));
  }
  for (const leg_threshold_t& threshold : from.thresholds) {
    const int quantity = threshold.quantity;
    if (quantity < 0 || quantity >= kLegQuantities || to.threshold_kind[quantity] != 0) {
      return Malformed(absl::StrCat(place, ": threshold quantity ", quantity,
                                    " is unknown or there twice"));
    }
    if (threshold.above != 0 && threshold.above != 1) {
      return Malformed(absl::StrCat(place, ": a threshold's above must be 0 or 1"));
    }
    if (!std::isfinite(threshold.value)) {
      return Malformed(absl::StrCat(place, ": a threshold is not finite"));
    }
    to.threshold[quantity] = threshold.value;
    to.threshold_kind[quantity] = threshold.above == 1 ? 1 : 2;
  }
  return absl::OkStatus();
}

absl::Status ConvertLegSets(const std::vector<leg_parameter_set_t>& from, ParametersText& text) {
  text.size = text.padding = 0;
  if (from.empty()) return absl::OkStatus();
  LegParameterSets to = {};
  for (const leg_parameter_set_t& set : from) {
    const int index = set.index;
    if (index < 0 || index >= kLegSets || (to.present >> index & 1u) != 0) {
      return Malformed(absl::StrCat("leg set index ", index, " is unknown or there twice"));
    }
    to.present |= 1u << index;
    for (int state = 0; state < kLegStates; ++state) {
      RETURN_IF_ERROR(ConvertState(set.states[state], Place(index, state), to.set[index][state]));
    }
  }
  const std::string json = LegSetsToJson(to).dump();
  if (json.size() > kMaxParameterBytes) return Malformed("the leg parameter sets are too long");
  text.size = static_cast<uint32_t>(json.size());
  std::memcpy(text.text, json.data(), json.size());
  return absl::OkStatus();
}

template <typename Message>
absl::Status Decode(std::span<const std::byte> payload, Message& message) {
  const int size = static_cast<int>(payload.size());
  if (message.decode(payload.data(), 0, size) != size) {
    return Malformed("the message can't be decoded");
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status DecodeHello(std::span<const std::byte> payload, HelloFrame& frame) {
  Cursor cursor(payload);
  if (!FingerprintFits<hello_t>(cursor)) return WrongFingerprint("hello_t");
  cursor.Skip(sizeof(int32_t));
  const int32_t name = cursor.Int32();  // LCM counts the terminating NUL
  if (cursor.ok() && (name < 1 || name > kMaxName + 1)) {
    return Malformed(absl::StrCat("the policy's name must have at most ", kMaxName, " bytes"));
  }
  cursor.Skip(static_cast<size_t>(name - 1));
  if (cursor.Unsigned(1) != 0) return Malformed("the policy's name has no ending zero byte");
  cursor.Skip(1);  // `direct`
  RETURN_IF_ERROR(WalkLegSets(cursor));
  RETURN_IF_ERROR(WalkEnd(cursor));
  hello_t message;
  RETURN_IF_ERROR(Decode(payload, message));
  if (message.direct != 0 && message.direct != 1) return Malformed("direct must be 0 or 1");
  frame.protocol_version = static_cast<uint32_t>(message.protocol_version);
  frame.convention =
      message.direct == 1 ? ActionConvention::kDirect : ActionConvention::kNormalized;
  return ConvertLegSets(message.leg_sets, frame.parameters);
}

absl::Status DecodeReady(std::span<const std::byte> payload, ReadyFrame& frame) {
  Cursor cursor(payload);
  if (!FingerprintFits<episode_ready_t>(cursor)) return WrongFingerprint("episode_ready_t");
  cursor.Skip(sizeof(int64_t));
  RETURN_IF_ERROR(WalkLegSets(cursor));
  RETURN_IF_ERROR(WalkEnd(cursor));
  episode_ready_t message;
  RETURN_IF_ERROR(Decode(payload, message));
  frame.episode = message.episode;
  return ConvertLegSets(message.leg_sets, frame.parameters);
}

absl::Status DecodeAction(std::span<const std::byte> payload, uint32_t action_size,
                          action_t& scratch, ActionFrame& frame) {
  Cursor cursor(payload);
  if (!FingerprintFits<action_t>(cursor)) return WrongFingerprint("action_t");
  cursor.Skip(2 * sizeof(int64_t));
  const int32_t size = cursor.Int32();
  if (!cursor.ok()) return Malformed("the message ends too early");
  if (action_size != 0 && size != static_cast<int32_t>(action_size)) {
    return Malformed(absl::StrCat("the action has ", size, " entries, must have ", action_size));
  }
  if (size < 0 || size > kMaxActionSize) {
    return Malformed(absl::StrCat("the action has ", size, " entries, too many or too few"));
  }
  cursor.Skip(static_cast<size_t>(size) * sizeof(double));
  RETURN_IF_ERROR(WalkEnd(cursor));
  RETURN_IF_ERROR(Decode(payload, scratch));
  for (int32_t i = 0; i < size; ++i) {
    if (!std::isfinite(scratch.values[static_cast<size_t>(i)])) {
      return Malformed(absl::StrCat("entry ", i, " of the action is not a finite number"));
    }
  }
  frame.episode = scratch.episode;
  frame.step = scratch.step;
  frame.size = static_cast<uint32_t>(size);
  frame.padding = 0;
  if (size > 0) {
    std::memcpy(frame.values, scratch.values.data(), static_cast<size_t>(size) * sizeof(double));
  }
  return absl::OkStatus();
}

absl::Status DecodeGiveUp(std::span<const std::byte> payload, GiveUpFrame& frame) {
  Cursor cursor(payload);
  if (!FingerprintFits<give_up_t>(cursor)) return WrongFingerprint("give_up_t");
  cursor.Skip(2 * sizeof(int64_t));
  RETURN_IF_ERROR(WalkEnd(cursor));
  give_up_t message{};
  RETURN_IF_ERROR(Decode(payload, message));
  frame.episode = message.episode;
  frame.step = message.step;
  return absl::OkStatus();
}

}  // namespace myograde::bridge
