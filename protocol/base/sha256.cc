#include "protocol/base/sha256.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"

namespace myograde {
namespace {

// OpenSSL fails here only if it is out of memory or lacks SHA-256; a wrong digest must never
// result, so the process aborts.
void Require(bool holds) {
  if (holds) return;
  std::fputs("OpenSSL can't compute SHA-256 digests on this host\n", stderr);
  std::abort();
}

}  // namespace

struct Sha256::Context {
  Context() : evp(EVP_MD_CTX_new()), copy(EVP_MD_CTX_new()) {
    Require(evp != nullptr && copy != nullptr);
    Start();
  }
  ~Context() {
    EVP_MD_CTX_free(evp);
    EVP_MD_CTX_free(copy);
  }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  void Start() {
    Require(EVP_DigestInit_ex(evp, EVP_sha256(), nullptr) == 1);
  }

  EVP_MD_CTX* evp;
  EVP_MD_CTX* copy;  // for Peek, which is called in every step
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {}
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;
Sha256::~Sha256() = default;

void Sha256::Update(std::span<const std::byte> data) {
  Require(EVP_DigestUpdate(context_->evp, data.data(), data.size()) == 1);
}

void Sha256::Update(std::string_view data) {
  Update(std::as_bytes(std::span(data.data(), data.size())));
}

Sha256Digest Sha256::Finish() {
  Sha256Digest digest;
  unsigned int size = 0;
  Require(EVP_DigestFinal_ex(context_->evp, digest.data(), &size) == 1 && size == digest.size());
  context_->Start();
  return digest;
}

Sha256Digest Sha256::Peek() const {
  Sha256Digest digest;
  unsigned int size = 0;
  Require(EVP_MD_CTX_copy_ex(context_->copy, context_->evp) == 1 &&
          EVP_DigestFinal_ex(context_->copy, digest.data(), &size) == 1 && size == digest.size());
  return digest;
}

std::string Sha256::FinishHex() { return ToHex(Finish()); }

std::string ToHex(std::span<const uint8_t> bytes) {
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

bool IsSha256Hex(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

Sha256Digest Sha256Of(std::string_view data) {
  Sha256 hash;
  hash.Update(data);
  return hash.Finish();
}

std::string Sha256Hex(std::string_view data) { return ToHex(Sha256Of(data)); }

absl::StatusOr<std::string> Sha256File(const std::string& path) {
  // O_NONBLOCK: opening a FIFO without a writer must not hang.
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.valid()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", std::strerror(errno)));
  }
  struct stat info;
  if (::fstat(file.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": is not a regular file"));
  }
  Sha256 hash;
  std::vector<std::byte> buffer(1u << 16);
  while (true) {
    const ssize_t count = ::read(file.get(), buffer.data(), buffer.size());
    if (count == 0) return hash.FinishHex();
    if (count > 0) {
      hash.Update(std::span(buffer).first(static_cast<size_t>(count)));
    } else if (errno != EINTR) {
      return absl::UnavailableError(
          absl::StrCat(path, ": reading failed: ", std::strerror(errno)));
    }
  }
}

}  // namespace myograde
