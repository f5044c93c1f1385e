#include "sim/film/png.h"

#include <png.h>

#include <absl/strings/str_cat.h>

namespace myograde::sim {

absl::StatusOr<std::string> EncodePng(std::span<const uint8_t> rgb, int width, int height) {
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = PNG_FORMAT_RGB;
  std::string out(PNG_IMAGE_PNG_SIZE_MAX(image), '\0');
  png_alloc_size_t size = out.size();
  if (png_image_write_to_memory(&image, out.data(), &size, /*convert_to_8_bit=*/0, rgb.data(),
                                /*row_stride=*/0, /*colormap=*/nullptr) == 0) {
    return absl::InternalError(absl::StrCat("libpng can't write the picture: ", image.message));
  }
  out.resize(size);
  return out;
}

}  // namespace myograde::sim
