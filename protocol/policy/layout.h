// The layout of observation and action vectors: the single source for the welcome message,
// `myograde spec`, the documentation and the tests. Each track's is in
// protocol/tracks/<track>/layout.cc.
#pragma once

#include <cstdint>
#include <deque>
#include <numbers>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace myograde {

// How a policy expresses the actions of muscles and motors.
enum class ActionConvention : uint32_t { kNormalized = 0, kDirect = 1 };

struct Part {
  std::string_view name;     // "arm_qpos"
  int offset;
  int size;
  std::string_view unit;     // "rad"
  std::string_view meaning;  // one sentence, with frame and order
};

struct Bounds {
  double low;
  double high;
};

// One entry of a part: its name ("" if the part is a single number) and its bounds.
struct LayoutEntry {
  std::string_view name;
  Bounds bounds;
};

// What many tracks observe: a place's or a velocity's axes, Euler angles, and velocities.
inline constexpr std::string_view kAxes[] = {"x", "y", "z"};
inline constexpr std::string_view kAngles[] = {"roll", "pitch", "yaw"};
inline constexpr Bounds kAnyAngle{-std::numbers::pi, std::numbers::pi};
inline constexpr Bounds kAnyRotation{-2 * std::numbers::pi, 2 * std::numbers::pi};  // of two angles
inline constexpr Bounds kSpeed{-100, 100};  // m/s and rad/s: far beyond ordinary play

// Entries with the same bounds, one per name.
std::vector<LayoutEntry> LayoutEntries(std::span<const std::string_view> names, Bounds bounds);

// A vector's layout, built part by part. What its getters return stays valid as long as the object,
// which may be moved, and is complete once the last part is added.
class VectorLayout {
 public:
  VectorLayout() = default;
  VectorLayout(VectorLayout&&) = default;

  void Add(std::string_view name, std::string_view unit, std::string_view meaning,
           const std::vector<LayoutEntry>& entries);

  int size() const { return static_cast<int>(bounds_.size()); }
  // Without gaps, in order.
  std::span<const Part> parts() const { return parts_; }
  // Names of the entries, in order: "part.entry".
  std::span<const std::string_view> names() const { return names_; }
  std::span<const Bounds> bounds() const { return bounds_; }

 private:
  std::vector<Part> parts_;
  std::deque<std::string> full_names_;  // a deque keeps addresses stable
  std::vector<std::string_view> names_;
  std::vector<Bounds> bounds_;
};

struct TrackLayout {
  // Bounds hold in ordinary play (joint ranges where they exist, else wide); not enforced.
  VectorLayout observation;
  // What the official observation dictionary has beyond it, for submissions that ask for extra
  // observations: the entries follow those of `observation` then. May be empty.
  VectorLayout extra;
  VectorLayout action;                // bounds: in the normalized convention
  std::vector<Bounds> direct_bounds;  // of the action in the direct convention

  std::span<const Bounds> action_bounds(ActionConvention convention) const {
    return convention == ActionConvention::kDirect ? direct_bounds : action.bounds();
  }
};

}  // namespace myograde
