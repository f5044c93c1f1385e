// Mesa's off-screen renderer: OpenGL in software, into memory, without a display. The library is
// loaded when the first picture is asked for, so that programs run where it is not installed.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde::sim {

struct OsMesaFunctions;

// An OpenGL context with a buffer of its own. Any thread may use it, but one at a time.
class OsMesaContext {
 public:
  // FailedPreconditionError names what is missing: the library, a function of it, or an OpenGL
  // extension that MuJoCo draws with.
  static absl::StatusOr<std::unique_ptr<OsMesaContext>> Make(int width, int height);
  ~OsMesaContext();
  OsMesaContext(const OsMesaContext&) = delete;
  OsMesaContext& operator=(const OsMesaContext&) = delete;

  // Makes OpenGL's calls of this thread go to this context, until Release. InternalError if Mesa
  // can't.
  absl::Status MakeCurrent();
  void Release();

 private:
  OsMesaContext(const OsMesaFunctions& functions, int width, int height);
  absl::Status Create();
  absl::Status CheckExtensions() const;

  const OsMesaFunctions& functions_;
  int width_;
  int height_;
  std::vector<uint8_t> buffer_;  // Mesa wants one; MuJoCo draws into its own
  void* context_ = nullptr;      // an OSMesaContext
};

}  // namespace myograde::sim
