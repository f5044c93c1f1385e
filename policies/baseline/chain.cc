#include "policies/baseline/chain.h"

#include <algorithm>
#include <cmath>

namespace myograde::baseline {
namespace {

constexpr double kDamping = 0.02;  // m/rad
constexpr double kToRest = 0.02;   // share of the way that a step goes
constexpr double kFurthest = 0.1;  // m and rad: what a step corrects at most

using Jacobian = Eigen::Matrix<double, 6, kChainAngles>;

struct HingeNow {
  int angle;
  Eigen::Vector3d place, axis;  // the axis times the ratio
};

// The last link's, with the hinges before it.
struct Frame {
  Pose pose;
  std::vector<HingeNow> turned;
};

// Of place and rotation vector, by the angles.
Jacobian SlopesAt(const std::vector<HingeNow>& turned, const Eigen::Vector3d& place) {
  Jacobian slopes = Jacobian::Zero();
  for (const HingeNow& hinge : turned) {
    slopes.block<3, 1>(0, hinge.angle) += hinge.axis.cross(place - hinge.place);
    slopes.block<3, 1>(3, hinge.angle) += hinge.axis;
  }
  return slopes;
}

// Goes along the chain; `at(link, place, turn, turned)` is told where each link's frame is.
template <typename At>
Frame FrameOf(const std::vector<Link>& links, const Eigen::Vector3d& grasp,
              const ChainAngles& angles, At at) {
  Frame frame;
  std::vector<HingeNow>& turned = frame.turned;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  for (const Link& link : links) {
    place += turn * link.place;
    turn = turn * link.turn;
    for (const Hinge& hinge : link.hinges) {
      turned.push_back({hinge.angle, place, turn * hinge.axis * hinge.ratio});
      turn = turn * Eigen::AngleAxisd(hinge.ratio * angles[hinge.angle], hinge.axis);
    }
    at(link, place, turn, turned);
  }
  frame.pose.place = place + turn * grasp;
  frame.pose.turn = turn.normalized();
  return frame;
}

constexpr auto kNothing = [](const auto&...) {};

Eigen::Vector3d RotationVector(const Eigen::Quaterniond& turn) {
  const Eigen::AngleAxisd about(turn.w() < 0 ? Eigen::Quaterniond(-turn.coeffs()) : turn);
  return about.angle() * about.axis();
}

Eigen::Vector3d Shortened(const Eigen::Vector3d& way) {
  return way * std::min(1.0, kFurthest / std::max(way.norm(), 1e-9));
}

}  // namespace

Pose Chain::Of(const ChainAngles& angles) const {
  return FrameOf(links_, grasp_, angles, kNothing).pose;
}

ChainInertia Chain::Inertia(const ChainAngles& angles) const {
  ChainInertia sum = ChainInertia::Zero();
  FrameOf(links_, grasp_, angles,
          [&sum](const Link& link, const Eigen::Vector3d& place, const Eigen::Quaterniond& turn,
                 const std::vector<HingeNow>& turned) {
            if (link.mass == 0) return;
            const Jacobian slopes = SlopesAt(turned, place + turn * link.middle);
            const Eigen::Matrix3d axes = turn.toRotationMatrix();
            sum += link.mass * slopes.topRows<3>().transpose() * slopes.topRows<3>();
            sum += slopes.bottomRows<3>().transpose() *
                   (axes * link.inertia.asDiagonal() * axes.transpose()) * slopes.bottomRows<3>();
          });
  return sum;
}

ChainAngles Chain::Nearer(const ChainAngles& angles, const Pose& goal, double turn_weight,
                          const ChainAngles& rest, const ChainAngles& ease) const {
  const Frame frame = FrameOf(links_, grasp_, angles, kNothing);
  Jacobian slopes = SlopesAt(frame.turned, frame.pose.place);
  slopes.bottomRows<3>() *= turn_weight;
  Eigen::Matrix<double, 6, 1> missing;
  missing << Shortened(goal.place - frame.pose.place),
      turn_weight * Shortened(RotationVector(goal.turn * frame.pose.turn.conjugate()));
  Jacobian used = slopes;
  for (int i = 0; i < kChainAngles; ++i) used.col(i) *= ease[i];
  const Eigen::Matrix<double, 6, 6> damped =
      slopes * used.transpose() + kDamping * kDamping * Eigen::Matrix<double, 6, 6>::Identity();
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(damped);
  using Angles = Eigen::Matrix<double, kChainAngles, 1>;
  const Angles now = Eigen::Map<const Angles>(angles.data());
  const Angles home = kToRest * (Eigen::Map<const Angles>(rest.data()) - now);
  // What leads to the goal, and of the way to `rest` what the goal leaves free.
  const Angles step = used.transpose() * solver.solve(missing - slopes * home) + home;
  ChainAngles next;
  for (int i = 0; i < kChainAngles; ++i) {
    next[i] = std::clamp(angles[i] + step[i], ranges_[i].low, ranges_[i].high);
  }
  return next;
}

// Bodies and joints of the model's files; chains_test compares both arms with the model.
const Chain& MuscleArm() {
  static const Chain chain(
      {
          {{-0.025, 0.1, 1.4}, {1, 0, 0, 0}, {}},
          {{0.006325, -0.02547, 0.00693},
           {0.500398, 0.5, -0.5, -0.499602},
           {{1, -0.242, {0.0153, 0.989299, -0.1451}}, {1, 0.1025, {-0.994473, 0, -0.104997}}},
           0.156,
           {-0.0111, 0.0064, 0.0542},
           {0.001, 0.001, 0.001}},
          {{-0.01433, 0.02007, 0.1355},
           {1, 0, 0, 0},
           {{1, -0.1025, {-0.994473, 0, -0.104997}}, {1, 0.242, {0.0153, 0.989299, -0.1451}}},
           0.001,
           {0, 0, 0},
           {1, 1, 1}},
          {{0, 0, 0},
           {1, 0, 0, 0},
           {{1, -0.049, {0.157095, 0.947269, -0.279291}},
            {1, 0.396, {-0.754084, 0.297594, 0.585487}},
            {1, 0.178, {0.6377, 0.1186, 0.7611}}},
           0.704,
           {-0.0547, -0.035, -0.0437},
           {0.00139, 0.00126, 0.00138}},
          {{-0.00955, -0.034, 0.009},
           {1, 0, 0, 0},
           {{1, -0.178, {0.6377, 0.1186, 0.7611}},
            {1, -0.396, {-0.754084, 0.297594, 0.585487}},
            {1, 0.049, {0.157095, 0.947269, -0.279291}}},
           0.001,
           {0, 0, 0},
           {1, 1, 1}},
          {{0, 0, 0},
           {1, 0, 0, 0},
           {{0, 1, {0.0048, 0.999089, 0.0424}}},
           0.001,
           {0, 0, 0},
           {1, 1, 1}},
          {{0, 0, 0},
           {1, 0, 0, 0},
           {{1, 1, {-0.998261, 0.0023, 0.058898}}, {0, -1, {0.0048, 0.999089, 0.0424}}},
           0.001,
           {0, 0, 0},
           {1, 1, 1}},
          {{0, 0, 0},
           {1, 0, 0, 0},
           {{2, 1, {0.0048, 0.999089, 0.0424}}},
           1.9976,
           {0.0181, -0.1401, -0.0127},
           {0.01228, 0.00255, 0.01258}},
          {{0.0061, -0.2904, -0.0123},
           {1, 0, 0, 0},
           {{3, 1, {0.0494, 0.0366, 0.998108}}},
           1.1053,
           {0.0097, -0.096, 0.0243},
           {0.00541, 0.0013, 0.00495}},
          {{0.0004, -0.0115, 0.02},
           {1, 0, 0, 0},
           {{4, 1, {-0.017161, 0.992666, -0.119668}}},
           0.2336,
           {0.0336, -0.1816, 0.0156},
           {0.001, 0.001, 0.001}},
          {{0.018, -0.242, 0.025},
           {1, 0, 0, 0},
           {{5, 1, {0, 0, 1}}, {6, 1, {1, 0, 0}}},
           0.2238,
           {-0.0017, -0.0087, -0.0025},
           {0.0004, 0.00041, 0.00041}},
          {{0.003992, -0.015054, 0.002327},
           {1, 0, 0, 0},
           {},
           0.1738,
           {-0.0021, -0.0423, 0.0023},
           {0.00208, 0.00194, 0.00211}},
          {{0.015293, -0.004569, -0.010308},
           {1, 0, 0, 0},
           {},
           0.0469,
           {0.0084, -0.0196, -0.0128},
           {0.00043, 0.00041, 0.00043}},
      },
      {-0.011, -0.06, -0.03},
      {{{-1.5, 2.2},
        {0.05, 3},
        {-1.5, 2},
        {0.05, 2.2},
        {-1.5, 1.5},
        {-0.15, 0.41},
        {-0.75, 0.75}}});
  return chain;
}

const Chain& ProstheticArm() {
  static const Chain chain(
      {
          {{0.18, 0.1, 1.38}, {0.500398, 0.5, -0.5, -0.499602}, {}},
          {{0, 0, 0}, {1, 0, 0, 0}, {{0, 1, {0, 0, 1}}}},
          {{0.0016428, 0, 0}, {1, 0, 0, 0}, {{1, 1, {-1, 0, 0}}}},
          {{-0.0016397, -0.15007, -0.013891}, {1, 0, 0, 0}, {{2, 1, {0, -1, 0}}}},
          {{0.01, -0.14441, -0.0006524}, {1, 0, 0, 0}, {{3, 1, {0, 0, 1}}}},
          {{0, -0.15, 0}, {0.000796327, 0, 1, 0}, {}},
          {{0, 0, 0}, {1, 0, 0, 0}, {{4, 1, {0, 1, 0}}}},
          {{0.0000337, -0.0476452, 0.0020376}, {1, 0, 0, 0}, {{5, 1, {0, 0, -1}}}},
          {{-0.0001872, -0.03, -0.002094}, {1, 0, 0, 0}, {{6, 1, {1, 0, 0}}}},
          {{-0.025625, 0, 0}, {1, 0, 0, 0}, {}},
      },
      {0.0205, -0.042, -0.05},
      {{{-0.6, 2.7},
        {-2.7, 0},
        {-0.52, 1.48},
        {0.05, 2.35},
        {-1.57, 1.57},
        {-0.26, 0.78},
        {-1, 1}}});
  return chain;
}

}  // namespace myograde::baseline
