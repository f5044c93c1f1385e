#include "sim/trajectory/model_file.h"

#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "sim/model/compile.h"
#include "sim/model/model.h"
#include "sim/render/paint.h"
#include "sim/trajectory/figure.h"
#include "sim/trajectory/glb.h"

namespace myograde::sim {
namespace {

using Json = nlohmann::json;

// Raise it with any change of what the file has.
constexpr int kModelFileRevision = 4;
constexpr size_t kKeyDigits = 16;
// Meshes are simplified on grids with a side of kFinest times a power of kCoarser times the cube root of the
// mesh's size: what is small is looked at from near, but not as much nearer as it is smaller.
constexpr double kFinest = 1e-3;      // m^(2/3)
constexpr double kCoarser = 1.04;
constexpr int kMostCoarser = 100;     // the largest power
constexpr size_t kFewFaces = 400;     // of a mesh that stays as it is
constexpr int kMostVisibleGroup = 2;  // later ones are for collisions and marks
constexpr double kSquare = 1;         // m, side of the floor's squares
// From MuJoCo's axes (z up) to those of glTF (y up): a quarter turn about x.
constexpr Placement kUpright = {{0, 0, 0}, {M_SQRT1_2, -M_SQRT1_2, 0, 0}};

double Micro(double number) { return std::round(number * 1e6) / 1e6; }

Json Micro(const std::array<double, 3>& numbers) {
  return {Micro(numbers[0]), Micro(numbers[1]), Micro(numbers[2])};
}

std::set<int> WrapGeoms(const mjModel& model) {
  std::set<int> geoms;
  for (int i = 0; i < model.nwrap; ++i) {
    if (model.wrap_type[i] == mjWRAP_SPHERE || model.wrap_type[i] == mjWRAP_CYLINDER) {
      geoms.insert(model.wrap_objid[i]);
    }
  }
  return geoms;
}

bool IsGround(const mjModel& model, int geom) {
  return model.geom_type[geom] == mjGEOM_PLANE || model.geom_type[geom] == mjGEOM_HFIELD;
}

// A geom in the frame of its part.
Placement PlaceOf(const mjModel& model, const Figure& figure, int geom) {
  const RelativePose body = PoseInPart(model, figure, model.geom_bodyid[geom]);
  Placement place;
  place.position = PointInPart(model, figure, model.geom_bodyid[geom], model.geom_pos + 3 * geom);
  mju_mulQuat(place.rotation.data(), body.rotation.data(), model.geom_quat + 4 * geom);
  return place;
}

// Puts the shapes of a model into a file.
class ModelFile {
 public:
  // `coarseness`: of meshes, in m^(2/3).
  ModelFile(const mjModel& model, const Figure& figure, double coarseness)
      : model_(model), figure_(figure), coarseness_(coarseness) {}

  std::string Write(const Json& extras) {
    const std::vector<Placement> places = FirstPlaces();
    std::vector<int> children = {AddPart("static", Placement(), -1)};
    for (size_t i = 0; i < figure_.parts.size(); ++i) {
      const char* name = mj_id2name(&model_, mjOBJ_BODY, figure_.parts[i]);
      children.push_back(AddPart(name, places[i], static_cast<int>(i)));
    }
    const int world = glb_.AddNode("world", kUpright);
    glb_.SetChildren(world, children);
    return glb_.Finish(world, extras);
  }

 private:
  // Of the parts, in the model's first state.
  std::vector<Placement> FirstPlaces() const {
    const DataPtr data(mj_makeData(&model_));
    if (model_.nkey > 0) {
      mj_resetDataKeyframe(&model_, data.get(), 0);
    } else {
      mj_resetData(&model_, data.get());
    }
    mj_kinematics(&model_, data.get());
    std::vector<Placement> places;
    for (const int body : figure_.parts) {
      Placement place;
      mju_copy3(place.position.data(), data->xpos + 3 * body);
      mju_copy4(place.rotation.data(), data->xquat + 4 * body);
      places.push_back(place);
    }
    return places;
  }

  // The node of a part, or of what is fixed (-1), with its shapes.
  int AddPart(const std::string& name, const Placement& place, int part) {
    std::vector<int> shapes;
    for (int geom = 0; geom < model_.ngeom; ++geom) {
      if (figure_.part_of[model_.geom_bodyid[geom]] != part || !IsShown(geom)) continue;
      const int mesh = MeshFor(geom);
      if (mesh >= 0) shapes.push_back(glb_.AddNode("", PlaceOf(model_, figure_, geom), mesh));
    }
    const int node = glb_.AddNode(name, place);
    glb_.SetChildren(node, shapes);
    return node;
  }

  bool IsShown(int geom) const {
    return model_.geom_group[geom] <= kMostVisibleGroup && !IsGround(model_, geom) &&
           !wraps_.contains(geom) && GeomColour(model_, geom)[3] > 0;
  }

  // A mesh that several geoms show is there once for each colour.
  int MeshFor(int geom) {
    const int material = glb_.AddMaterial(GeomColour(model_, geom));
    const bool asset = model_.geom_type[geom] == mjGEOM_MESH;
    const std::pair key(asset ? model_.geom_dataid[geom] : -1 - geom, material);
    const auto found = meshes_.find(key);
    if (found != meshes_.end()) return found->second;
    Mesh mesh = BuildMesh(model_, geom);
    if (mesh.faces.size() > kFewFaces) {
      mesh = Simplified(mesh, coarseness_ * std::cbrt(SizeOf(mesh)));
    }
    return meshes_[key] =
               mesh.faces.empty() ? -1 : glb_.AddMesh(WithNormals(mesh), material);
  }

  const mjModel& model_;
  const Figure& figure_;
  const double coarseness_;
  const std::set<int> wraps_ = WrapGeoms(model_);
  GlbWriter glb_;
  std::map<std::pair<int, int>, int> meshes_;  // by mesh asset (or geom) and material
};

Json PartName(const mjModel& model, const Figure& figure, int part) {
  if (part < 0) return nullptr;
  return mj_id2name(&model, mjOBJ_BODY, figure.parts[part]);
}

Json MusclesToJson(const mjModel& model, const Figure& figure) {
  Json muscles = Json::array();
  for (const MusclePath& muscle : figure.muscles) {
    Json path = Json::array();
    for (const PathPoint& point : muscle.points) {
      Json entry = {{"body", PartName(model, figure, point.part)}};
      if (point.wrap >= 0) {
        entry["wrap"] = point.wrap;
      } else {
        entry["at"] = Micro(point.at);
      }
      path.push_back(std::move(entry));
    }
    muscles.push_back({{"name", muscle.name},
                       {"radius_m", Micro(muscle.radius)},
                       {"path", std::move(path)}});
  }
  return muscles;
}

Json FloorToJson(const mjModel& model) {
  for (int geom = 0; geom < model.ngeom; ++geom) {
    if (model.geom_type[geom] != mjGEOM_PLANE) continue;
    const mjtNum* size = model.geom_size + 3 * geom;
    return {{"height_m", model.geom_pos[3 * geom + 2]},
            {"half_size_m", {size[0], size[1]}},
            {"square_m", kSquare}};
  }
  return nullptr;
}

Json CameraToJson(const CameraView& view) {
  return {{"body", view.body.empty() ? Json() : Json(view.body)},
          {"look_at", view.look_at},
          {"distance_m", view.distance_m},
          {"azimuth_deg", view.azimuth_deg},
          {"elevation_deg", view.elevation_deg}};
}

}  // namespace

std::string ModelFileKey(const ModelSource& source) {
  return Sha256Hex(absl::StrCat(ModelKey(source), " file ", kModelFileRevision))
      .substr(0, kKeyDigits);
}

absl::StatusOr<std::string> MakeModelFile(const mjModel& model, std::string_view track,
                                          const std::string& key, const CameraView& view) {
  ASSIGN_OR_RETURN(const Figure figure, BuildFigure(model));
  const Json extras = {{"format", 1},
                       {"track", track},
                       {"model", key},
                       {"camera", CameraToJson(view)},
                       {"muscles", MusclesToJson(model, figure)},
                       {"floor", FloorToJson(model)}};
  // As fine as fits.
  std::string best;
  for (int low = 0, high = kMostCoarser; low < high;) {
    const int middle = (low + high) / 2;
    std::string file = ModelFile(model, figure, kFinest * std::pow(kCoarser, middle)).Write(extras);
    if (file.size() > kMostModelFileBytes) {
      low = middle + 1;
    } else {
      high = middle;
      best = std::move(file);
    }
  }
  if (!best.empty()) return best;
  return absl::ResourceExhaustedError(
      absl::StrCat("the model of track \"", std::string(track), "\" has too many shapes for a file of ",
                   kMostModelFileBytes, " bytes"));
}

}  // namespace myograde::sim
