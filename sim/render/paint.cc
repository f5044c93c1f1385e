#include "sim/render/paint.h"

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <string_view>

namespace myograde::sim {
namespace {

using Colour = std::array<float, 3>;

constexpr Colour kBone = {0.89F, 0.85F, 0.75F};
constexpr Colour kSlackMuscle = {0.86F, 0.62F, 0.60F};
constexpr Colour kFullMuscle = {0.78F, 0.02F, 0.05F};
constexpr Colour kFloorDark = {0.62F, 0.66F, 0.70F};
constexpr Colour kFloorLight = {0.72F, 0.75F, 0.78F};
constexpr Colour kHorizon = {0.93F, 0.95F, 0.97F};
constexpr Colour kZenith = {0.55F, 0.69F, 0.85F};

// How far below a height field a floor is drawn: level with it, the two would flicker.
constexpr float kBelowField = 0.005F;  // m

enum Texture { kSky, kFloor };
constexpr int kSkySide = 64;     // pixels, of each of a cube's faces
constexpr int kFloorSide = 128;  // pixels

struct MaterialColour {
  std::string_view material;
  Colour colour;
};

// Materials that were nothing but a texture.
constexpr MaterialColour kMaterials[] = {
    {"009_gelatin_box", {0.80F, 0.22F, 0.20F}},
    {"matfloor", {1, 1, 1}},
    {"groundfloor", {1, 1, 1}},
    {"pillar_start", {0.45F, 0.52F, 0.60F}},
    {"pillar_goal", {0.36F, 0.60F, 0.44F}},
    {"prosthesis/MatMesh", {0.32F, 0.34F, 0.38F}},
    {"prosthesis/matmetal", {0.62F, 0.64F, 0.67F}},
    {"matmyo", {0.83F, 0.38F, 0.20F}},
    {"matwood", {0.62F, 0.47F, 0.33F}},
    {"tabletop", {0.78F, 0.77F, 0.74F}},
};

void Append(std::vector<mjtByte>& rgb, const Colour& colour) {
  for (const float part : colour) rgb.push_back(static_cast<mjtByte>(255 * part));
}

Colour Mix(const Colour& from, const Colour& to, float share) {
  Colour mixed;
  for (size_t i = 0; i < mixed.size(); ++i) mixed[i] = from[i] + share * (to[i] - from[i]);
  return mixed;
}

// Six faces, one below the other: right, left, up, down, front, back.
void AppendSky(std::vector<mjtByte>& rgb) {
  for (int face = 0; face < 6; ++face) {
    for (int row = 0; row < kSkySide; ++row) {
      const float height = 1 - 2 * static_cast<float>(row) / (kSkySide - 1);
      const float share = face == 2 ? 1 : face == 3 ? 0 : std::clamp(height, 0.F, 1.F);
      for (int column = 0; column < kSkySide; ++column) Append(rgb, Mix(kHorizon, kZenith, share));
    }
  }
}

void AppendFloor(std::vector<mjtByte>& rgb) {
  for (int row = 0; row < kFloorSide; ++row) {
    for (int column = 0; column < kFloorSide; ++column) {
      const bool dark = (row < kFloorSide / 2) == (column < kFloorSide / 2);
      Append(rgb, dark ? kFloorDark : kFloorLight);
    }
  }
}

bool IsWhite(const float* rgba) { return rgba[0] == 1 && rgba[1] == 1 && rgba[2] == 1; }

// What MuJoCo gives to geoms that name no colour.
bool IsDefault(const float* rgba) {
  return rgba[0] == 0.5F && rgba[1] == 0.5F && rgba[2] == 0.5F;
}

void SetColour(mjvGeom& geom, const Colour& colour) {
  std::copy(colour.begin(), colour.end(), geom.rgba);
}

// Floors: one square is a metre wide, so that distances can be seen.
void ShowFloor(mjvGeom& geom) {
  geom.texid = kFloor;
  geom.texuniform = 1;
  geom.texrepeat[0] = geom.texrepeat[1] = 1;
  geom.reflectance = 0;
  SetColour(geom, {1, 1, 1});
}

void PaintGeom(const mjModel& model, mjvGeom& geom) {
  const int material = model.geom_matid[geom.objid];
  const int type = model.geom_type[geom.objid];
  if (type == mjGEOM_PLANE && model.nhfield > 0) geom.pos[2] -= kBelowField;
  if (type == mjGEOM_HFIELD || type == mjGEOM_PLANE) return ShowFloor(geom);
  if (material < 0 && type == mjGEOM_MESH && IsDefault(geom.rgba)) return SetColour(geom, kBone);
  if (material < 0 || !IsWhite(geom.rgba)) return;
  const char* name = mj_id2name(&model, mjOBJ_MATERIAL, material);
  const auto* found = std::ranges::find(kMaterials, name == nullptr ? "" : name,
                                        &MaterialColour::material);
  SetColour(geom, found == std::end(kMaterials) ? kBone : found->colour);
}

// The muscle that pulls a tendon, as its place in the list of actuators; -1: none does.
int Muscle(const mjModel& model, int tendon) {
  for (int i = 0; i < model.nu; ++i) {
    if (model.actuator_trntype[i] == mjTRN_TENDON && model.actuator_trnid[2 * i] == tendon) {
      return i;
    }
  }
  return -1;
}

// Muscles are the redder, the more active they are.
std::vector<std::optional<Colour>> TendonColours(const mjModel& model, const mjData& data) {
  std::vector<std::optional<Colour>> colours(static_cast<size_t>(model.ntendon));
  for (int tendon = 0; tendon < model.ntendon; ++tendon) {
    const int muscle = Muscle(model, tendon);
    // Activations are those of the actuators that have one, which come last.
    const int activation = muscle - (model.nu - model.na);
    if (muscle < 0 || activation < 0) continue;
    const auto share = static_cast<float>(std::clamp(data.act[activation], 0.0, 1.0));
    colours[tendon] = Mix(kSlackMuscle, kFullMuscle, share);
  }
  return colours;
}

// Tendons without a muscle are lines for measuring: they are left out.
void PaintTendon(const std::optional<Colour>& muscle, mjvGeom& geom) {
  if (muscle) SetColour(geom, *muscle);
  geom.rgba[3] = muscle ? 1 : 0;
}

}  // namespace

Textures::Textures()
    : type_{mjTEXTURE_SKYBOX, mjTEXTURE_2D},
      height_{6 * kSkySide, kFloorSide},
      width_{kSkySide, kFloorSide},
      address_{0, 6 * kSkySide * kSkySide * 3} {
  AppendSky(rgb_);
  AppendFloor(rgb_);
}

void Textures::PutInto(mjModel& model) {
  model.ntex = static_cast<int>(type_.size());
  model.ntexdata = static_cast<int>(rgb_.size());
  model.tex_type = type_.data();
  model.tex_height = height_.data();
  model.tex_width = width_.data();
  model.tex_adr = address_.data();
  model.tex_rgb = rgb_.data();
}

void Paint(const mjModel& model, const mjData& data, mjvScene& scene) {
  const std::vector<std::optional<Colour>> tendons = TendonColours(model, data);
  for (mjvGeom& geom : std::span(scene.geoms, static_cast<size_t>(scene.ngeom))) {
    if (geom.objid < 0) continue;
    if (geom.objtype == mjOBJ_GEOM) PaintGeom(model, geom);
    if (geom.objtype == mjOBJ_TENDON) PaintTendon(tendons[geom.objid], geom);
  }
}

std::array<float, 4> GeomColour(const mjModel& model, int geom) {
  const int material = model.geom_matid[geom];
  const float* own = model.geom_rgba + 4 * geom;
  // A geom's colour takes the place of its material's, unless it is the default.
  const bool of_material = material >= 0 && IsDefault(own) && own[3] == 1;
  const float* named = of_material ? model.mat_rgba + 4 * material : own;
  mjvGeom shown = {};
  shown.objid = geom;
  std::copy_n(named, 4, shown.rgba);
  PaintGeom(model, shown);
  return {shown.rgba[0], shown.rgba[1], shown.rgba[2], shown.rgba[3]};
}

}  // namespace myograde::sim
