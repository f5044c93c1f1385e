#include "sim/episode/packed_log.h"

#include <unistd.h>
#include <zstd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <string_view>
#include <utility>

#include <absl/strings/str_cat.h>

namespace myograde::sim {
namespace {

constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";

absl::Status TooLarge() {
  return absl::DataLossError(
      absl::StrCat("the log is larger than ", kMaxLogBytes, " bytes, so it is none of an episode"));
}

absl::StatusOr<std::string> Unpack(const std::string& packed) {
  const std::unique_ptr<ZSTD_DCtx, size_t (*)(ZSTD_DCtx*)> context(ZSTD_createDCtx(),
                                                                   ZSTD_freeDCtx);
  std::string log;
  std::string block(ZSTD_DStreamOutSize(), '\0');
  ZSTD_inBuffer in = {packed.data(), packed.size(), 0};
  size_t left = 1;
  bool progress = true;
  while (in.pos < in.size || (left != 0 && progress)) {
    ZSTD_outBuffer out = {block.data(), block.size(), 0};
    left = ZSTD_decompressStream(context.get(), &out, &in);
    if (ZSTD_isError(left)) {
      return absl::DataLossError(
          absl::StrCat("the log can't be unpacked (", ZSTD_getErrorName(left),
                       "); the file was altered or damaged"));
    }
    progress = out.pos > 0;
    log.append(block, 0, out.pos);
    if (log.size() > kMaxLogBytes) return TooLarge();
  }
  if (left != 0) return absl::DataLossError("the log can't be unpacked: the file is cut");
  return log;
}

}  // namespace

absl::StatusOr<std::string> ReadLogFile(int fd) {
  std::string bytes;
  std::string buffer(256 << 10, '\0');
  while (true) {
    const ssize_t n = read(fd, buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      return absl::DataLossError(absl::StrCat("the log can't be read: ", std::strerror(errno)));
    }
    if (n == 0) break;
    bytes.append(buffer, 0, static_cast<size_t>(n));
    if (bytes.size() > kMaxLogBytes) return TooLarge();
  }
  const bool packed = std::string_view(bytes).starts_with(kZstdMagic);
  return packed ? Unpack(bytes) : absl::StatusOr<std::string>(std::move(bytes));
}

}  // namespace myograde::sim
