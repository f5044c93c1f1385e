#include "policies/baseline/reacher_parameters.h"

#include <algorithm>
#include <array>
#include <deque>
#include <vector>

#include "policies/baseline/parameter_file.h"

namespace myograde::baseline {
namespace {

struct Range {
  const char* name;
  double low, high;  // rad
};

constexpr std::array<const char*, kChainAngles> kJoints = {
    "elevation_plane", "elevation", "rotation", "elbow", "pronation", "deviation", "wrist"};
constexpr int kElbow = 3;
constexpr ChainAngles kStiffness = {200, 200, 50, 60, 12, 8, 8};  // N m/rad
constexpr int kThumb = 4, kFinger = 4, kFingers = 4;  // joints, joints of each finger, fingers
// The joints of the thumb, and those that all fingers share.
constexpr std::array<Range, kThumb + kFinger> kHand = {{
    {"thumb_abduction", -0.53, 0.7},
    {"thumb_flexion", -0.75, 0.85},
    {"thumb_middle", -0.8, 1.2},
    {"thumb_tip", -1.4, 1},
    {"finger_base", -0.2, 2.5},
    {"finger_abduction", -0.27, 0.27},
    {"finger_middle", -0.2, 2.5},
    {"finger_tip", -0.2, 2.2},
}};

// The servos of the prosthesis' hand, in their order.
constexpr std::array<Range, kProsthesisHand> kServos = {{
    {"thumb_abduction", 0, 2.07},
    {"thumb_base", 0, 1},
    {"thumb_middle", 0, 1},
    {"thumb_tip", -0.8, 1.28},
    {"index_abduction", 0, 0.34},
    {"index", 0, 1.57},
    {"middle", 0, 1.57},
    {"ring", 0, 1.57},
    {"little_abduction", 0, 0.34},
    {"little", 0, 1.57},
}};
constexpr ProsthesisHand kOffered = {1.47, 0, 0, 0, 0.1, 0.1, 0.3, 0.5, 0, 0.6};
constexpr ProsthesisHand kTaken = {1.47, 0.5, 0.5, 0.2, 0.1, 0.9, 0.9, 1, 0, 1.1};

struct Target {
  const char* name;
  double time;  // s
  std::array<double, 3> place;
  double reach;  // m, how far from there it may be
};

// Takes the plan's numbers one after the other: the order of this walk is that of the parameters.
// `next(name, start, deviation, low, high)` is asked for each of them.
template <typename Next>
class Walk {
 public:
  explicit Walk(Next next) : next_(next) {}

  ReacherPlan Plan() {
    ReacherPlan plan;
    plan.gains = Gains();
    plan.open = Hand("open_", false);
    plan.closed = Hand("closed_", true);
    plan.beside = Way({"beside", 0.6, {-0.12, 0.02, 0.03}, 0.1});
    constexpr std::array<double, 3> kAround = {-0.05, 0, 0.08};
    for (int i = 0; i < 3; ++i) {
      plan.around[i] = next_(std::string("around_") + "xyz"[i], kAround[i], 0.02, -0.2, 0.2);
    }
    plan.at = Way({"at", 0.4, {-0.015, 0, 0}, 0.06});
    plan.close_time = Time("close", 0.3);
    plan.lift = Way({"lift", 0.5, {0.03, 0, 0.15}, 0.15});
    plan.give = Way({"give", 0.8, {-0.09, -0.26, 1.22}, 0.2});
    plan.take_time = Time("take", 1);
    plan.release_time = Time("release", 0.4);
    plan.away = Way({"away", 0.6, {-0.15, 0, -0.02}, 0.3});
    plan.offer = Way({"offer", 1, {-0.04, -0.25, 1.2}, 0.2});
    for (const bool taken : {false, true}) {
      for (int i = 0; i < kProsthesisHand; ++i) {
        (taken ? plan.taken : plan.offered)[i] =
            next_(std::string(taken ? "taken_" : "offered_") + kServos[i].name,
                  (taken ? kTaken : kOffered)[i], 0.15, kServos[i].low, kServos[i].high);
      }
    }
    plan.over_time = Time("over", 0.8);
    plan.over = next_("over_height", 0.12, 0.02, 0.05, 0.3);
    plan.put_time = Time("put", 0.5);
    plan.put = next_("put_height", 0.03, 0.01, -0.05, 0.15);
    plan.open_time = Time("placed", 0.4);
    plan.leave_time = Time("leave", 0.6);
    constexpr std::array<double, 3> kBack = {0.12, 0, 0.03};
    for (int i = 0; i < 3; ++i) {
      plan.leave[i] = next_(std::string("leave_") + "xyz"[i], kBack[i], 0.03, -0.2, 0.3);
    }
    return plan;
  }

  CarrierPlan Carry() {
    CarrierPlan plan;
    plan.gains.rate = next_("rate", 20, 2, 5, 60);
    plan.gains.damping = next_("damping", 0.7, 0.1, 0.1, 3);
    plan.gains.integral = next_("integral", 0.3, 0.3, 0, 20);
    plan.gains.hand_stiffness = next_("hand_stiffness", 1.5, 0.3, 0, 20);
    plan.gains.hand_damping = next_("hand_damping", 0.03, 0.006, 0, 1);
    plan.rest = kPalmBeside;
    for (int j = 0; j < kElbow; ++j) {
      plan.rest[j] = next_(std::string("rest_") + kJoints[j], plan.rest[j], 0.15, -1.5, 2);
    }
    plan.ease = next_("ease", 0.3, 0.1, 0.02, 1);
    plan.open = Hand("open_", false);
    plan.closed = Hand("closed_", true);
    plan.yaw = next_("yaw", 0.5, 0.1, -1, 2);
    plan.beside = Way({"beside", 0.35, {-0.08, 0.02, 0.03}, 0.15});
    plan.at = Way({"at", 0.15, {-0.015, 0, 0}, 0.1});
    plan.close_time = Time("close", 0.15);
    plan.over = Way({"over", 0.5, {0, 0, 0.25}, 0.2});
    plan.turn_weight = next_("turn_weight", 0.06, 0.01, 0, 0.2);
    plan.over_turn_weight = next_("over_turn_weight", 0.03, 0.01, 0, 0.12);
    plan.rise = next_("rise", 0.7, 0.1, 0.2, 1);
    plan.lag = next_("lag", 0.2, 0.1, 0, 0.8);
    plan.correction = next_("correction", 4, 1, 0, 20);
    plan.aim = next_("aim", 0.12, 0.02, 0.01, 0.4);
    plan.let_go = next_("let_go", 0.1, 0.02, 0, 0.3);
    plan.open_time = Time("open", 0.06);
    plan.freed = Hand("freed_", false);
    return plan;
  }

 private:
  ArmGains Gains() {
    ArmGains plan;
    for (int j = 0; j < kChainAngles; ++j) {
      plan.stiffness[j] = next_(std::string("stiffness_") + kJoints[j], kStiffness[j],
                                0.1 * kStiffness[j], 0.1 * kStiffness[j], 10 * kStiffness[j]);
    }
    plan.damping = next_("damping", 1, 0.1, 0.1, 3);
    plan.integral = next_("integral", 1.5, 0.3, 0, 20);
    plan.hand_stiffness = next_("hand_stiffness", 1.5, 0.3, 0, 20);
    plan.hand_damping = next_("hand_damping", 0.03, 0.006, 0, 1);
    return plan;
  }

  HandAngles Hand(const std::string& prefix, bool closed) {
    std::array<double, kThumb + kFinger> shared{};
    for (size_t i = 0; i < shared.size(); ++i) {
      const Range& joint = kHand[i];
      const double start = closed && i >= kThumb ? joint.high / 2 : 0;
      shared[i] = next_(prefix + joint.name, start, 0.15, joint.low, joint.high);
    }
    HandAngles hand{};
    std::copy_n(shared.begin(), kThumb, hand.begin());
    for (int f = 0; f < kFingers; ++f) {
      std::copy_n(shared.begin() + kThumb, kFinger, hand.begin() + kThumb + f * kFinger);
    }
    return hand;
  }

  double Time(const std::string& name, double start) {
    return next_(name + "_time", start, 0.08, 0.05, 4);
  }

  HandPlan Way(const Target& start) {
    const std::string name = start.name;
    HandPlan plan;
    plan.time = Time(name, start.time);
    for (int i = 0; i < 3; ++i) {
      const std::string axis(1, "xyz"[i]);
      plan.place[i] = next_(name + "_" + axis, start.place[i], 0.015, start.place[i] - start.reach,
                            start.place[i] + start.reach);
    }
    for (int i = 0; i < 3; ++i) {
      plan.turn[i] = next_(name + "_turn_" + std::string(1, "xyz"[i]), 0, 0.1, -2, 2);
    }
    return plan;
  }

  Next next_;
};

struct Table {
  std::deque<std::string> names;  // which stay where they are, for `infos` points to them
  std::vector<ParameterInfo> infos;
};

// What `walk` asks its argument for, a Next.
template <typename Asking>
Table TableOf(Asking walk) {
  Table out;
  walk([&out](const std::string& name, double start, double deviation, double low, double high) {
    out.names.push_back(name);
    out.infos.push_back({out.names.back().c_str(), start, deviation, low, high});
    return start;
  });
  return out;
}

// Answers with `numbers`, one after the other.
auto Given(std::span<const double> numbers) {
  return [numbers, i = size_t{0}](const std::string&, double, double, double, double) mutable {
    return numbers[i++];
  };
}

}  // namespace

std::span<const ParameterInfo> ReacherParameters() {
  static const Table table = TableOf([](auto next) { Walk(next).Plan(); });
  return table.infos;
}

std::span<const ParameterInfo> CarrierParameters() {
  static const Table table = TableOf([](auto next) { Walk(next).Carry(); });
  return table.infos;
}

ReacherPlan MakePlan(std::span<const double> numbers) { return Walk(Given(numbers)).Plan(); }

CarrierPlan MakeCarrierPlan(std::span<const double> numbers) {
  return Walk(Given(numbers)).Carry();
}

ReacherPlan ReadReacherPlan(const std::string& path) {
  return MakePlan(ReadNumbers(path, ReacherParameters()));
}

}  // namespace myograde::baseline
