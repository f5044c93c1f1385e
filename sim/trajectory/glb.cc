#include "sim/trajectory/glb.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"

namespace myograde::sim {
namespace {

using Json = nlohmann::json;

// Numbers that the format gives its terms.
constexpr int kByte = 5120, kUnsignedShort = 5123, kUnsignedInt = 5125;
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;

constexpr int kVertexBytes = 12;  // three shorts, padding, three bytes, padding
constexpr int kNormalOffset = 8;
constexpr double kWhole = 65535;

void AppendNumber(std::string& out, uint32_t number, int bytes) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<char>(number >> (8 * i) & 0xFF));
}

// From how it is shown to the light that it stands for.
double Linear(double shown) {
  return shown <= 0.04045 ? shown / 12.92 : std::pow((shown + 0.055) / 1.055, 2.4);
}

double Rounded6(double number) { return std::round(number * 1e6) / 1e6; }

Json Rotation(const std::array<double, 4>& q) {
  // glTF wants unit length to the last digit that it compares; six digits are enough for that.
  return {Rounded6(q[1]), Rounded6(q[2]), Rounded6(q[3]), Rounded6(q[0])};
}

uint32_t Turned(const std::array<float, 3>& normal, int axis) {
  const long value = std::lround(normal[axis] * 127);
  return static_cast<uint32_t>(std::clamp(value, -127L, 127L)) & 0xFF;
}

std::string Chunk(uint32_t type, std::string content, char padding) {
  while (content.size() % 4 != 0) content.push_back(padding);
  std::string chunk;
  AppendNumber(chunk, static_cast<uint32_t>(content.size()), 4);
  AppendNumber(chunk, type, 4);
  return chunk + content;
}

}  // namespace

int GlbWriter::AddView(const std::string& bytes, int stride, int target) {
  Json view = {{"buffer", 0},
               {"byteOffset", bytes_.size()},
               {"byteLength", bytes.size()},
               {"target", target}};
  if (stride > 0) view["byteStride"] = stride;
  views_.push_back(std::move(view));
  bytes_ += bytes;
  while (bytes_.size() % 4 != 0) bytes_.push_back('\0');
  return static_cast<int>(views_.size()) - 1;
}

int GlbWriter::AddAccessor(nlohmann::json accessor) {
  accessors_.push_back(std::move(accessor));
  return static_cast<int>(accessors_.size()) - 1;
}

int GlbWriter::AddMesh(const Mesh& mesh, int material) {
  std::array<float, 3> low = mesh.points.front(), high = low;
  for (const auto& point : mesh.points) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], point[axis]);
      high[axis] = std::max(high[axis], point[axis]);
    }
  }
  Grid grid = {{low[0], low[1], low[2]}, 1e-6};
  for (int axis = 0; axis < 3; ++axis) grid.size = std::max<double>(grid.size, high[axis] - low[axis]);
  std::string vertices;
  std::array<uint32_t, 3> least = {65535, 65535, 65535}, most = {0, 0, 0};
  for (size_t i = 0; i < mesh.points.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto number = static_cast<uint32_t>(
          std::lround((mesh.points[i][axis] - grid.origin[axis]) / grid.size * kWhole));
      least[axis] = std::min(least[axis], number);
      most[axis] = std::max(most[axis], number);
      AppendNumber(vertices, number, 2);
    }
    AppendNumber(vertices, 0, 2);
    for (int axis = 0; axis < 3; ++axis) AppendNumber(vertices, Turned(mesh.normals[i], axis), 1);
    AppendNumber(vertices, 0, 1);
  }
  const bool wide = mesh.points.size() > 65535;
  std::string indices;
  for (const auto& face : mesh.faces) {
    for (const uint32_t corner : face) AppendNumber(indices, corner, wide ? 4 : 2);
  }
  const int vertex_view = AddView(vertices, kVertexBytes, kArrayBuffer);
  const int index_view = AddView(indices, 0, kElementArrayBuffer);
  const auto bounds = [](const std::array<uint32_t, 3>& numbers) {
    return Json(std::array<uint32_t, 3>{numbers[0], numbers[1], numbers[2]});
  };
  const int position = AddAccessor({{"bufferView", vertex_view},
                                    {"componentType", kUnsignedShort},
                                    {"normalized", true},
                                    {"count", mesh.points.size()},
                                    {"type", "VEC3"},
                                    {"min", bounds(least)},
                                    {"max", bounds(most)}});
  const int normal = AddAccessor({{"bufferView", vertex_view},
                                  {"byteOffset", kNormalOffset},
                                  {"componentType", kByte},
                                  {"normalized", true},
                                  {"count", mesh.points.size()},
                                  {"type", "VEC3"}});
  const int index = AddAccessor({{"bufferView", index_view},
                                 {"componentType", wide ? kUnsignedInt : kUnsignedShort},
                                 {"count", 3 * mesh.faces.size()},
                                 {"type", "SCALAR"}});
  meshes_.push_back({{"primitives",
                      {{{"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
                        {"indices", index},
                        {"material", material}}}}});
  grids_.push_back(grid);
  return static_cast<int>(meshes_.size()) - 1;
}

int GlbWriter::AddMaterial(const std::array<float, 4>& colour) {
  const auto found = std::find(colours_.begin(), colours_.end(), colour);
  if (found != colours_.end()) return static_cast<int>(found - colours_.begin());
  Json material = {{"pbrMetallicRoughness",
                    {{"baseColorFactor",
                      {Rounded6(Linear(colour[0])), Rounded6(Linear(colour[1])),
                       Rounded6(Linear(colour[2])), Rounded6(colour[3])}},
                     {"metallicFactor", 0},
                     {"roughnessFactor", 0.7}}}};
  if (colour[3] < 1) material["alphaMode"] = "BLEND";
  materials_.push_back(std::move(material));
  colours_.push_back(colour);
  return static_cast<int>(colours_.size()) - 1;
}

int GlbWriter::AddNode(const std::string& name, const Placement& place, int mesh) {
  std::array<double, 3> position = place.position;
  Json node = Json::object();
  if (!name.empty()) node["name"] = name;
  if (mesh >= 0) {
    // The mesh's numbers count from a corner of its grid.
    const Grid& grid = grids_[static_cast<size_t>(mesh)];
    mjtNum corner[3];
    mju_rotVecQuat(corner, grid.origin.data(), place.rotation.data());
    mju_addTo3(position.data(), corner);
    node["mesh"] = mesh;
    node["scale"] = std::array<double, 3>{grid.size, grid.size, grid.size};
  }
  node["translation"] = {Rounded6(position[0]), Rounded6(position[1]), Rounded6(position[2])};
  node["rotation"] = Rotation(place.rotation);
  nodes_.push_back(std::move(node));
  return static_cast<int>(nodes_.size()) - 1;
}

void GlbWriter::SetChildren(int node, const std::vector<int>& children) {
  if (!children.empty()) nodes_[static_cast<size_t>(node)]["children"] = children;
}

std::string GlbWriter::Finish(int root, const nlohmann::json& extras) {
  const Json document = {
      {"asset", {{"version", "2.0"}, {"generator", "MyoGrade"}}},
      {"extensionsUsed", {"KHR_mesh_quantization"}},
      {"extensionsRequired", {"KHR_mesh_quantization"}},
      {"scene", 0},
      {"scenes", {{{"nodes", {root}}, {"extras", extras}}}},
      {"nodes", nodes_},
      {"meshes", meshes_},
      {"materials", materials_},
      {"accessors", accessors_},
      {"bufferViews", views_},
      {"buffers", {{{"byteLength", bytes_.size()}}}}};
  const std::string body = Chunk(kJsonChunk, CanonicalJson(document), ' ') +
                           Chunk(kBinaryChunk, bytes_, '\0');
  std::string file;
  AppendNumber(file, kMagic, 4);
  AppendNumber(file, 2, 4);
  AppendNumber(file, static_cast<uint32_t>(body.size() + 12), 4);
  return file + body;
}

}  // namespace myograde::sim
