#include "sim/model/contact_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "sim/model/rotation.h"

namespace myograde::sim {
namespace contact_search {
namespace {

using Eigen::Vector3d;

thread_local bool sorted = false;
thread_local const BoundingTrees* trees = nullptr;

bool Touches(const mjModel& model, int geom) {
  return model.geom_contype[geom] != 0 || model.geom_conaffinity[geom] != 0;
}

// A point of a body in its inertial frame, m.
Vector3d InInertialFrame(const mjModel& model, int body, const Vector3d& point) {
  mjtNum inverse[4];
  mju_negQuat(inverse, model.body_iquat + 4 * body);
  const Vector3d from_centre = point - Vector3d::Map(model.body_ipos + 3 * body);
  Vector3d local;
  mju_rotVecQuat(local.data(), from_centre.data(), inverse);
  return local;
}

struct PlacedBox {
  PlacedBox(const Vector3d& box_centre, Vector3d half_size, const mjtNum* position,
            const mjtNum* rotation)
      : axes(Rotation::Map(rotation)),
        centre(Vector3d::Map(position) + axes * box_centre),
        half(std::move(half_size)) {}

  double ExtentAlong(const Vector3d& direction) const {
    return (axes.transpose() * direction).cwiseAbs().dot(half);
  }

  Rotation axes;
  Vector3d centre;
  Vector3d half;
};

// Only the directions of the boxes' own axes are tried.
bool Overlap(const PlacedBox& one, const PlacedBox& two, double margin) {
  const Vector3d apart = two.centre - one.centre;
  for (const Rotation& axes : {one.axes, two.axes}) {
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d direction = axes.col(axis);
      if (one.ExtentAlong(direction) + two.ExtentAlong(direction) + margin <
          std::abs(direction.dot(apart))) {
        return false;
      }
    }
  }
  return true;
}

// What the official search takes for half a box's surface.
double SurfaceOf(const Vector3d& centre, const Vector3d& half) {
  const Vector3d edge = half - centre;
  return edge.x() * edge.y() + edge.y() * edge.z() + edge.z() * edge.x();
}

// MuJoCo's own filter, which a callback replaces.
bool MayTouch(const mjModel& model, int geom1, int geom2) {
  if ((model.geom_contype[geom1] & model.geom_conaffinity[geom2]) == 0 &&
      (model.geom_contype[geom2] & model.geom_conaffinity[geom1]) == 0) {
    return false;
  }
  const int weld1 = model.body_weldid[model.geom_bodyid[geom1]];
  const int weld2 = model.body_weldid[model.geom_bodyid[geom2]];
  if (weld1 == weld2) return false;
  const bool filters =
      (model.opt.disableflags & mjDSBL_FILTERPARENT) == 0 && weld1 != 0 && weld2 != 0;
  return !filters || (weld1 != model.body_weldid[model.body_parentid[weld2]] &&
                      weld2 != model.body_weldid[model.body_parentid[weld1]]);
}

// 1: the pair is left out.
int Filter(const mjModel* model, mjData* data, int geom1, int geom2) {
  if (!MayTouch(*model, geom1, geom2)) return 1;
  return trees != nullptr && !trees->Reach(*model, *data, geom1, geom2) ? 1 : 0;
}

// 3.1.2 sorts them by their shapes, once a pair's simpler shape has become the first. 2.2.2 lists
// them before that, by the first body's shapes.
void SortContactsOfPairs(const mjModel& model, mjData& data) {
  const auto bodies = [&](const mjContact& contact) {
    return std::minmax(model.geom_bodyid[contact.geom1], model.geom_bodyid[contact.geom2]);
  };
  const auto shapes = [](const mjContact& contact) {
    return std::pair(contact.geom1, contact.geom2);
  };
  mjContact* const end = data.contact + data.ncon;
  for (mjContact *first = data.contact, *last; first != end; first = last) {
    const std::pair<int, int> pair = bodies(*first);
    last = std::find_if(first, end, [&](const mjContact& contact) {
      return std::pair<int, int>(bodies(contact)) != pair;
    });
    std::stable_sort(first, last, [&](const mjContact& one, const mjContact& two) {
      return shapes(one) < shapes(two);
    });
  }
}

}  // namespace
}  // namespace contact_search

using contact_search::PlacedBox;
using Eigen::Vector3d;

BoundingTrees::BoundingTrees(const mjModel& model, std::vector<int> bodies)
    : bodies_(std::move(bodies)),
      geom_boxes_(static_cast<size_t>(model.ngeom)),
      paths_(static_cast<size_t>(model.ngeom)) {
  for (int geom = 0; geom < model.ngeom; ++geom) geom_boxes_[geom] = HalfSizeOf(model, geom);
  for (int body = 1; body < model.nbody; ++body) {
    std::vector<int> geoms(static_cast<size_t>(model.body_geomnum[body]));
    std::iota(geoms.begin(), geoms.end(), model.body_geomadr[body]);
    Build(model, body, geoms, {});
  }
}

Vector3d BoundingTrees::HalfSizeOf(const mjModel& model, int geom) {
  const Vector3d size = Vector3d::Map(model.geom_size + 3 * geom);
  switch (model.geom_type[geom]) {
    case mjGEOM_SPHERE:
      return Vector3d::Constant(size[0]);
    case mjGEOM_CAPSULE:
      return {size[0], size[0], size[0] + size[1]};
    case mjGEOM_CYLINDER:
      return {size[0], size[0], size[1]};
    default:
      return size;
  }
}

// Halves at the median of the geoms' positions along the longest edge, as the official compiler
// does. Geoms that touch nothing count there, but are in no box.
void BoundingTrees::Build(const mjModel& model, int body, const std::vector<int>& geoms,
                          Path path) {
  using contact_search::InInertialFrame;
  Vector3d low = Vector3d::Constant(mjMAXVAL), high = -low;
  for (const int geom : geoms) {
    if (!contact_search::Touches(model, geom)) continue;
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3d sign(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      const Vector3d local = sign.cwiseProduct(geom_boxes_[geom]);
      Vector3d turned;
      mju_rotVecQuat(turned.data(), local.data(), model.geom_quat + 4 * geom);
      const Vector3d point =
          InInertialFrame(model, body, turned + Vector3d::Map(model.geom_pos + 3 * geom));
      low = low.cwiseMin(point);
      high = high.cwiseMax(point);
    }
  }
  if (low.x() > high.x()) return;
  path.push_back({(high + low) / 2, (high - low) / 2});
  if (geoms.size() == 1) {
    paths_[geoms[0]] = std::move(path);
    return;
  }
  const Vector3d edges = high - low;
  int axis = edges[0] > edges[1] ? 0 : 1;
  if (edges[axis] <= edges[2]) axis = 2;
  std::vector<double> places;
  for (const int geom : geoms) {
    places.push_back(InInertialFrame(model, body, Vector3d::Map(model.geom_pos + 3 * geom))[axis]);
  }
  std::vector<double> sorted = places;
  std::sort(sorted.begin(), sorted.end());
  const double median = sorted[sorted.size() / 2];
  std::vector<int> left, right;
  for (size_t i = 0; i < geoms.size(); ++i) {
    if (!contact_search::Touches(model, geoms[i])) continue;
    const bool to_left = places[i] < median || (places[i] == median && left.size() < right.size());
    (to_left ? left : right).push_back(geoms[i]);
  }
  if (!left.empty()) Build(model, body, left, path);
  if (!right.empty()) Build(model, body, right, path);
}

bool BoundingTrees::Reach(const mjModel& model, const mjData& data, int geom1, int geom2) const {
  if (model.geom_bodyid[geom1] > model.geom_bodyid[geom2]) std::swap(geom1, geom2);
  const int body1 = model.geom_bodyid[geom1], body2 = model.geom_bodyid[geom2];
  const bool searched = std::ranges::any_of(
      bodies_, [&](int body) { return body == body1 || body == body2; });
  // Two bodies of one shape each are compared without their trees.
  if (!searched || (model.body_geomnum[body1] == 1 && model.body_geomnum[body2] == 1)) return true;
  const Path& path1 = paths_[geom1];
  const Path& path2 = paths_[geom2];
  if (path1.empty() || path2.empty()) return true;
  const double margin = std::max(model.geom_margin[geom1], model.geom_margin[geom2]);
  for (size_t i = 0, j = 0;;) {
    const bool leaf1 = i + 1 == path1.size(), leaf2 = j + 1 == path2.size();
    if (leaf1 && leaf2) {
      const auto placed = [&](int geom) {
        return PlacedBox(Vector3d::Zero(), geom_boxes_[geom], data.geom_xpos + 3 * geom,
                         data.geom_xmat + 9 * geom);
      };
      return Overlap(placed(geom1), placed(geom2), margin);
    }
    const Box &one = path1[i], &two = path2[j];
    const auto placed = [&](const Box& box, int body) {
      return PlacedBox(box.centre, box.half, data.xipos + 3 * body, data.ximat + 9 * body);
    };
    if (!Overlap(placed(one, body1), placed(two, body2), margin)) return false;
    const bool first = leaf2 || (!leaf1 && contact_search::SurfaceOf(one.centre, one.half) >
                                               contact_search::SurfaceOf(two.centre, two.half));
    ++(first ? i : j);
  }
}

ContactSearch::ContactSearch(const std::optional<BoundingTrees>& trees)
    : sorted_before_(std::exchange(contact_search::sorted, true)),
      trees_before_(
          std::exchange(contact_search::trees, trees.has_value() ? &*trees : nullptr)) {
  if (!trees.has_value()) return;
  // It stays: without trees it does what MuJoCo does.
  static const bool installed = (mjcb_contactfilter = contact_search::Filter) != nullptr;
  static_cast<void>(installed);
}

ContactSearch::~ContactSearch() {
  contact_search::sorted = sorted_before_;
  contact_search::trees = trees_before_;
}

void Forward(const mjModel& model, mjData& data) {
  if (!contact_search::sorted) return mj_forward(&model, &data);
  // mj_fwdPosition, with the contacts sorted before anything is made of them.
  mj_kinematics(&model, &data);
  mj_comPos(&model, &data);
  mj_camlight(&model, &data);
  mj_tendon(&model, &data);
  mj_crb(&model, &data);
  mj_factorM(&model, &data);
  mj_collision(&model, &data);
  contact_search::SortContactsOfPairs(model, data);
  mj_makeConstraint(&model, &data);
  mj_transmission(&model, &data);
  mj_projectConstraint(&model, &data);
  mj_sensorPos(&model, &data);
  mj_forwardSkip(&model, &data, mjSTAGE_POS, /*skipsensor=*/0);
}

void Integrate(const mjModel& model, mjData& data) {
  if (!contact_search::sorted) return mj_step(&model, &data);
  mj_checkPos(&model, &data);
  mj_checkVel(&model, &data);
  Forward(model, data);
  mj_checkAcc(&model, &data);
  mj_Euler(&model, &data);
}

}  // namespace myograde::sim
