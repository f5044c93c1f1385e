#include "server/pictures/packing.h"

#include <zlib.h>
#include <zstd.h>

#include <new>

namespace myograde::server {
namespace {

// Made once and sent often; higher levels take several times as long for a few hundredths.
constexpr int kZstdLevel = 12;
constexpr int kGzipLevel = 9;
constexpr int kGzipWindow = 15 + 16;  // the largest, with gzip's header
constexpr int kGzipMemory = 9;

}  // namespace

std::string CompressZstd(std::string_view bytes) {
  std::string packed(ZSTD_compressBound(bytes.size()), '\0');
  const size_t size = ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(),
                                    kZstdLevel);
  if (ZSTD_isError(size) != 0) throw std::bad_alloc();  // there is room, so memory is short
  packed.resize(size);
  return packed;
}

std::string CompressGzip(std::string_view bytes) {
  z_stream stream = {};
  if (deflateInit2(&stream, kGzipLevel, Z_DEFLATED, kGzipWindow, kGzipMemory,
                   Z_DEFAULT_STRATEGY) != Z_OK) {
    throw std::bad_alloc();
  }
  std::string packed(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

absl::StatusOr<std::string> UnpackZstd(std::string_view packed, size_t most) {
  const unsigned long long size = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (size == ZSTD_CONTENTSIZE_ERROR || size == ZSTD_CONTENTSIZE_UNKNOWN || size > most) {
    return absl::DataLossError("the file is not a zstd frame of a known size");
  }
  std::string bytes(size, '\0');
  const size_t got = ZSTD_decompress(bytes.data(), bytes.size(), packed.data(), packed.size());
  if (ZSTD_isError(got) != 0 || got != size) {
    return absl::DataLossError("the zstd frame is damaged");
  }
  return bytes;
}

}  // namespace myograde::server
