// SHA-256 digests of bytes in memory, of files, and of data that arrives in pieces.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde {

using Sha256Digest = std::array<uint8_t, 32>;

// Incremental hashing. Movable; not thread-safe.
class Sha256 {
 public:
  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();

  void Update(std::span<const std::byte> data);
  void Update(std::string_view data);

  // The digest of everything since construction or the last Finish(). Starts over.
  Sha256Digest Finish();
  // The same as 64 lower-case hexadecimal digits.
  std::string FinishHex();

  // The digest of everything so far, without finishing.
  Sha256Digest Peek() const;

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

// 64 lower-case hexadecimal digits.
std::string ToHex(std::span<const uint8_t> bytes);
bool IsSha256Hex(std::string_view text);

Sha256Digest Sha256Of(std::string_view data);
std::string Sha256Hex(std::string_view data);

// The digest of a regular file's content as hexadecimal digits. NotFoundError if it can't be
// opened, InvalidArgumentError if it is not a regular file, UnavailableError if reading fails.
absl::StatusOr<std::string> Sha256File(const std::string& path);

}  // namespace myograde
