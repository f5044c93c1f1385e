#include "sim/render/osmesa.h"

#include <GL/osmesa.h>
#include <dlfcn.h>

#include <cstring>
#include <string_view>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::sim {

struct OsMesaFunctions {
  decltype(&OSMesaCreateContextExt) create_context;
  decltype(&OSMesaDestroyContext) destroy_context;
  decltype(&OSMesaMakeCurrent) make_current;
  decltype(&OSMesaGetProcAddress) get_proc_address;
};

namespace {

constexpr const char* kLibrary = "libOSMesa.so.8";
constexpr std::string_view kInstall = "install it (Debian: apt-get install libosmesa6)";

// MuJoCo looks the functions up in the process itself, hence RTLD_GLOBAL. The library stays loaded:
// Mesa's threads can't be unloaded from under it.
absl::StatusOr<OsMesaFunctions> LoadFunctions() {
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_GLOBAL);
  if (library == nullptr) {
    return absl::FailedPreconditionError(
        absl::StrCat("pictures need Mesa's off-screen renderer, but ", kLibrary,
                     " can't be loaded: ", std::string(kInstall), "; ", dlerror()));
  }
  OsMesaFunctions functions = {};
  bool whole = true;
  const auto find = [&](auto& function, const char* name) {
    void* address = dlsym(library, name);
    whole = whole && address != nullptr;
    std::memcpy(&function, &address, sizeof(address));
  };
  find(functions.create_context, "OSMesaCreateContextExt");
  find(functions.destroy_context, "OSMesaDestroyContext");
  find(functions.make_current, "OSMesaMakeCurrent");
  find(functions.get_proc_address, "OSMesaGetProcAddress");
  if (whole) return functions;
  return absl::FailedPreconditionError(absl::StrCat(
      kLibrary, " is not Mesa's off-screen renderer: ", std::string(kInstall)));
}

const absl::StatusOr<OsMesaFunctions>& Functions() {
  static const absl::StatusOr<OsMesaFunctions> functions = LoadFunctions();
  return functions;
}

}  // namespace

OsMesaContext::OsMesaContext(const OsMesaFunctions& functions, int width, int height)
    : functions_(functions),
      width_(width),
      height_(height),
      buffer_(static_cast<size_t>(width) * height * 4) {}

OsMesaContext::~OsMesaContext() {
  if (context_ != nullptr) functions_.destroy_context(static_cast<OSMesaContext>(context_));
}

absl::StatusOr<std::unique_ptr<OsMesaContext>> OsMesaContext::Make(int width, int height) {
  const absl::StatusOr<OsMesaFunctions>& functions = Functions();
  if (!functions.ok()) return functions.status();
  std::unique_ptr<OsMesaContext> context(new OsMesaContext(*functions, width, height));
  RETURN_IF_ERROR(context->Create());
  return context;
}

absl::Status OsMesaContext::Create() {
  constexpr int kDepthBits = 24;
  constexpr int kStencilBits = 8;  // reflections
  context_ = functions_.create_context(OSMESA_RGBA, kDepthBits, kStencilBits, 0, nullptr);
  if (context_ == nullptr) return absl::InternalError("Mesa can't create an OpenGL context");
  RETURN_IF_ERROR(MakeCurrent());
  absl::Status status = CheckExtensions();
  Release();
  return status;
}

// MuJoCo ends the process where one of them is missing.
absl::Status OsMesaContext::CheckExtensions() const {
  const OSMESAproc address = functions_.get_proc_address("glGetString");
  decltype(&glGetString) get_string = nullptr;
  std::memcpy(&get_string, &address, sizeof(address));
  const auto* list = get_string == nullptr
                         ? nullptr
                         : reinterpret_cast<const char*>(get_string(GL_EXTENSIONS));
  const std::string_view extensions = list == nullptr ? "" : list;
  for (const char* needed : {"GL_ARB_framebuffer_object", "GL_ARB_vertex_buffer_object"}) {
    if (extensions.find(needed) == std::string_view::npos) {
      return absl::FailedPreconditionError(absl::StrCat(
          "pictures need the OpenGL extension ", needed, ", which this Mesa lacks: ",
          std::string(kInstall)));
    }
  }
  return absl::OkStatus();
}

absl::Status OsMesaContext::MakeCurrent() {
  if (functions_.make_current(static_cast<OSMesaContext>(context_), buffer_.data(),
                              GL_UNSIGNED_BYTE, width_, height_) == GL_TRUE) {
    return absl::OkStatus();
  }
  return absl::InternalError(
      absl::StrCat("Mesa can't draw pictures of ", width_, " by ", height_, " pixels"));
}

void OsMesaContext::Release() { functions_.make_current(nullptr, nullptr, GL_UNSIGNED_BYTE, 0, 0); }

}  // namespace myograde::sim
