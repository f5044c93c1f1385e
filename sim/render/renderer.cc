#include "sim/render/renderer.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "sim/render/osmesa.h"
#include "sim/render/paint.h"

namespace myograde::sim {
namespace {

constexpr int kMostGeoms = 10'000;  // the arm's tendons wrap in some 1,500 pieces
constexpr int kFastShadowSide = 1024;  // pixels; models ask for 4096

// What of a height field the graphics memory has a copy of.
std::vector<float> HeightField(const mjModel& model) {
  std::vector<float> content(model.hfield_data, model.hfield_data + model.nhfielddata);
  for (int i = 0; i < model.nhfield; ++i) {
    content.push_back(static_cast<float>(model.hfield_nrow[i]));
    content.push_back(static_cast<float>(model.hfield_ncol[i]));
    for (int j = 0; j < 4; ++j) {
      content.push_back(static_cast<float>(model.hfield_size[4 * i + j]));
    }
  }
  return content;
}

// OpenGL's first row is at the bottom.
void FlipRows(std::span<uint8_t> rgb, int height) {
  const size_t row = rgb.size() / height;
  for (int i = 0; i < height / 2; ++i) {
    std::swap_ranges(rgb.begin() + i * row, rgb.begin() + (i + 1) * row,
                     rgb.begin() + (height - 1 - i) * row);
  }
}

// MuJoCo's fonts are bitmaps of fixed sizes, and a line should be about a thirtieth of the picture.
int FontScale(int height) {
  if (height < 480) return mjFONTSCALE_50;
  if (height < 700) return mjFONTSCALE_100;
  if (height < 1000) return mjFONTSCALE_150;
  if (height < 1600) return mjFONTSCALE_200;
  return mjFONTSCALE_300;
}

// MuJoCo looks each byte up in a table of ASCII without asking whether it is in there.
std::string Printable(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0) == 0x80) continue;  // the rest of a character of UTF-8
    out.push_back((byte >= ' ' && byte < 0x7F) || c == '\n' ? c : '?');
  }
  return out;
}

mjvOption Options() {
  mjvOption options;
  mjv_defaultOption(&options);
  options.flags[mjVIS_RANGEFINDER] = 0;
  // Groups from 3 on are shapes for collisions and wrapping, and marks for measuring.
  std::fill_n(options.geomgroup + 3, mjNGROUP - 3, mjtByte{0});
  std::fill_n(options.sitegroup, mjNGROUP, mjtByte{0});
  return options;
}

}  // namespace

class Renderer::Implementation {
 public:
  Implementation(const mjModel& model, std::unique_ptr<OsMesaContext> opengl, int width, int height)
      : model_(model), opengl_(std::move(opengl)), width_(width), height_(height) {
    mjv_defaultScene(&scene_);
    mjr_defaultContext(&context_);
    mjv_makeScene(&model_, &scene_, kMostGeoms);
  }

  ~Implementation() {
    if (opengl_->MakeCurrent().ok()) {
      mjr_freeContext(&context_);
      opengl_->Release();
    }
    mjv_freeScene(&scene_);
  }

  int width() const { return width_; }
  int height() const { return height_; }

  // Copies meshes, height fields and textures to where OpenGL draws from.
  absl::Status Upload(Quality quality) {
    RETURN_IF_ERROR(opengl_->MakeCurrent());
    mjModel shown = model_;  // shares the arrays
    textures_.PutInto(shown);
    shown.vis.global.offwidth = width_;
    shown.vis.global.offheight = height_;
    if (quality == Quality::kFast) {
      shown.vis.quality.shadowsize = kFastShadowSide;
      shown.vis.quality.offsamples = 0;
    }
    mjr_makeContext(&shown, &context_, FontScale(height_));
    mjr_setBuffer(mjFB_OFFSCREEN, &context_);
    field_ = HeightField(model_);
    opengl_->Release();
    if (context_.currentBuffer == mjFB_OFFSCREEN) return absl::OkStatus();
    return absl::InternalError("MuJoCo can't draw into memory with this OpenGL");
  }

  absl::Status Draw(const mjData& data, const CameraView& view, std::span<uint8_t> rgb,
                    const PictureText& text) {
    if (rgb.size() != static_cast<size_t>(width_) * height_ * 3) {
      return absl::InvalidArgumentError(absl::StrCat("a picture of ", width_, " by ", height_,
                                                     " pixels does not have ", rgb.size(),
                                                     " bytes"));
    }
    ASSIGN_OR_RETURN(auto camera, Camera(data, view));
    RETURN_IF_ERROR(opengl_->MakeCurrent());
    UpdateScene(data, camera);
    const mjrRect whole = {0, 0, width_, height_};
    mjr_render(whole, &scene_, &context_);
    Write(text, whole);
    mjr_readPixels(rgb.data(), nullptr, whole, &context_);
    opengl_->Release();
    FlipRows(rgb, height_);
    return absl::OkStatus();
  }

 private:
  absl::StatusOr<mjvCamera> Camera(const mjData& data, const CameraView& view) const {
    mjvCamera camera;
    mjv_defaultCamera(&camera);
    camera.type = mjCAMERA_FREE;
    std::copy(view.look_at.begin(), view.look_at.end(), camera.lookat);
    camera.distance = view.distance_m;
    camera.azimuth = view.azimuth_deg;
    camera.elevation = view.elevation_deg;
    if (view.body.empty()) return camera;
    const std::string name(view.body);
    const int body = mj_name2id(&model_, mjOBJ_BODY, name.c_str());
    if (body < 0) return absl::InvalidArgumentError(absl::StrCat("the model has no body ", name));
    mju_addTo3(camera.lookat, data.xpos + 3 * body);
    return camera;
  }

  void Write(const PictureText& text, const mjrRect& whole) {
    const auto put = [&](mjtGridPos place, const std::string& left, const std::string& right) {
      if (left.empty()) return;
      mjr_overlay(mjFONT_NORMAL, place, whole, Printable(left).c_str(), Printable(right).c_str(),
                  &context_);
    };
    put(mjGRID_TOPLEFT, text.names, text.values);
    put(mjGRID_TOPRIGHT, text.title, "");
    put(mjGRID_BOTTOMLEFT, text.caption, "");
  }

  void UpdateScene(const mjData& data, mjvCamera& camera) {
    // MuJoCo takes the data as mutable because it borrows room on its stack; the state stays.
    mjv_updateScene(&model_, const_cast<mjData*>(&data), &options_, nullptr, &camera, mjCAT_ALL,
                    &scene_);
    Paint(model_, data, scene_);
    if (model_.nhfield == 0) return;
    if (std::vector<float> field = HeightField(model_); field != field_) {
      for (int i = 0; i < model_.nhfield; ++i) mjr_uploadHField(&model_, &context_, i);
      field_ = std::move(field);
    }
  }

  const mjModel& model_;
  std::unique_ptr<OsMesaContext> opengl_;
  int width_;
  int height_;
  Textures textures_;
  mjvOption options_ = Options();
  mjvScene scene_;
  mjrContext context_;
  std::vector<float> field_;
};

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::Make(const mjModel& model, int width,
                                                         int height, Quality quality) {
  if (std::min(width, height) < 1 || std::max(width, height) > kLargestSide) {
    return absl::InvalidArgumentError(absl::StrCat("a picture can't be ", width, " by ", height,
                                                   " pixels: both must be from 1 to ",
                                                   kLargestSide));
  }
  ASSIGN_OR_RETURN(auto opengl, OsMesaContext::Make(width, height));
  auto implementation =
      std::make_unique<Implementation>(model, std::move(opengl), width, height);
  RETURN_IF_ERROR(implementation->Upload(quality));
  return std::unique_ptr<Renderer>(new Renderer(std::move(implementation)));
}

Renderer::Renderer(std::unique_ptr<Implementation> implementation)
    : implementation_(std::move(implementation)) {}

Renderer::~Renderer() = default;

int Renderer::width() const { return implementation_->width(); }
int Renderer::height() const { return implementation_->height(); }

absl::Status Renderer::Draw(const mjData& data, const CameraView& view, std::span<uint8_t> rgb,
                            const PictureText& text) {
  return implementation_->Draw(data, view, rgb, text);
}

}  // namespace myograde::sim
