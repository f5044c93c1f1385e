#include "sim/manipulation/official.h"

#include <cmath>
#include <numbers>

#include "sim/manipulation/track.h"
#include "sim/model/official_steps.h"
#include "sim/model/rotation.h"

namespace myograde::sim {
namespace {

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
  const auto [thumb_side, little_side] = scene.prosthesis_palm_sites;
  OfficialView view;
  view.palm = SiteOf(data, scene.palm_site);
  for (int i = 0; i < kFingers; ++i) view.fingers.col(i) = SiteOf(data, scene.finger_sites[i]);
  view.prosthesis_palm = (SiteOf(data, thumb_side) + SiteOf(data, little_side)) / 2;
  view.prosthesis_orientation = OfficialEulerAngles(Rotation::Map(data.site_xmat + 9 * thumb_side));
  view.prosthesis_orientation_error =
      view.prosthesis_orientation - Eigen::Vector3d(std::numbers::pi, 0, std::numbers::pi);
  view.object = SiteOf(data, scene.touch_site);
  view.reach_error = view.palm - view.object;
  view.pass_error = view.prosthesis_palm - view.object;
  return view;
}

OfficialReward ComputeOfficialReward(const mjModel& model, const mjData& data,
                                     const Scene& scene, const OfficialView& view,
                                     const RewardReference& reference) {
  OfficialReward reward;
  const double open = (view.fingers.colwise() - view.palm).colwise().norm().sum();
  const double apart = (view.fingers.colwise() - view.object).colwise().norm().sum();
  const double lift = std::hypot(view.object.z() - reference.object_height,
                                 view.palm.z() - reference.palm_height);
  reward.reach_dist = LogDistance(view.reach_error.norm(), 1e-6);
  reward.act = MuscleEffort(model, data);
  reward.fin_open = std::exp(-5 * open);
  reward.fin_dis = LogDistance(apart, 1e-6);
  reward.lift_bonus = Bell(data.qpos[scene.elbow_qpos], 1);
  reward.lift_height = Bell(lift, 0.2);
  reward.pass_err = LogDistance(view.pass_error.norm(), 1e-3);
  reward.goal_dist = (view.object - reference.goal).norm();
  reward.dense = -0.1 * reward.reach_dist - 0.5 * reward.fin_dis - reward.pass_err;
  return reward;
}

}  // namespace myograde::sim
