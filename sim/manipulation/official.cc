#include "sim/manipulation/official.h"

#include <cmath>
#include <limits>
#include <numbers>

namespace myograde::sim {
namespace {

Vector3 Site(const mjData& data, int site) {
  const mjtNum* position = data.site_xpos + 3 * site;
  return {position[0], position[1], position[2]};
}

Vector3 Difference(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double Norm(const Vector3& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

double Distance(const Vector3& a, const Vector3& b) { return Norm(Difference(a, b)); }

// Euler angles of a row-major rotation matrix, with the official signs and its
// way out where the pitch is upright.
Vector3 EulerAngles(const mjtNum* r) {
  const double cosine = std::sqrt(r[8] * r[8] + r[5] * r[5]);
  const double pitch = -std::atan2(-r[2], cosine);
  if (cosine > 4 * std::numeric_limits<double>::epsilon()) {
    return {-std::atan2(r[5], r[8]), pitch, -std::atan2(r[1], r[0])};
  }
  return {0, pitch, -std::atan2(-r[3], r[4])};
}

// d + ln(d + offset): steep near zero.
double LogDistance(double distance, double offset) {
  return distance + std::log(distance + offset);
}

// 5 exp(-10 (x - best)^2) - 5: from -5 to 0.
double Bell(double x, double best) {
  return 5 * std::exp(-10 * (x - best) * (x - best)) - 5;
}

}  // namespace

OfficialView ComputeOfficialView(const mjData& data, const Scene& scene) {
  OfficialView view;
  view.palm = Site(data, scene.palm_site);
  for (int i = 0; i < kFingers; ++i) view.fingers[i] = Site(data, scene.finger_sites[i]);
  const Vector3 thumb_side = Site(data, scene.prosthesis_palm_sites[0]);
  const Vector3 little_side = Site(data, scene.prosthesis_palm_sites[1]);
  for (int i = 0; i < 3; ++i) view.prosthesis_palm[i] = (thumb_side[i] + little_side[i]) / 2;
  view.prosthesis_orientation =
      EulerAngles(data.site_xmat + 9 * scene.prosthesis_palm_sites[0]);
  view.prosthesis_orientation_error =
      Difference(view.prosthesis_orientation, {std::numbers::pi, 0, std::numbers::pi});
  view.object = Site(data, scene.touch_site);
  view.reach_error = Difference(view.palm, view.object);
  view.pass_error = Difference(view.prosthesis_palm, view.object);
  return view;
}

OfficialReward ComputeOfficialReward(const mjModel& model, const mjData& data,
                                     const Scene& scene, const OfficialView& view,
                                     const RewardReference& reference) {
  OfficialReward reward;
  double open = 0;
  double apart = 0;
  for (const Vector3& finger : view.fingers) {
    open += Distance(finger, view.palm);
    apart += Distance(finger, view.object);
  }
  const double lift = std::hypot(view.object[2] - reference.object_height,
                                 view.palm[2] - reference.palm_height);
  reward.reach_dist = LogDistance(Norm(view.reach_error), 1e-6);
  reward.act = mju_norm(data.act, model.na) / model.na;
  reward.fin_open = std::exp(-5 * open);
  reward.fin_dis = LogDistance(apart, 1e-6);
  reward.lift_bonus = Bell(data.qpos[scene.elbow_qpos], 1);
  reward.lift_height = Bell(lift, 0.2);
  reward.pass_err = LogDistance(Norm(view.pass_error), 1e-3);
  reward.goal_dist = Distance(view.object, reference.goal);
  reward.dense = -0.1 * reward.reach_dist - 0.5 * reward.fin_dis - reward.pass_err;
  return reward;
}

}  // namespace myograde::sim
