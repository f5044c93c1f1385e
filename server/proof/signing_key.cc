#include "server/proof/signing_key.h"

#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/sha256.h"

namespace myograde::server {
namespace {

constexpr size_t kSignatureBytes = 64;
constexpr size_t kMaxPemBytes = 16 << 10;

using BioPtr = std::unique_ptr<BIO, int (*)(BIO*)>;
using ContextPtr = std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)>;

std::string TextOf(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  return std::string(data, static_cast<size_t>(size));
}

absl::StatusOr<std::string> ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text(kMaxPemBytes, '\0');
  if (!file || !(file.read(text.data(), std::ssize(text)) || file.eof())) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the key can't be read: ", std::strerror(errno)));
  }
  text.resize(static_cast<size_t>(file.gcount()));
  return text;
}

// Under a name of its own first, then linked to `path`, which fails if a key has appeared there
// meanwhile: no reader sees half a key, and no key is ever lost.
absl::Status Store(EVP_PKEY* key, const std::string& path) {
  const BioPtr bio(BIO_new(BIO_s_mem()), BIO_free);
  if (PEM_write_bio_PrivateKey(bio.get(), key, nullptr, nullptr, 0, nullptr, nullptr) != 1) {
    return absl::InternalError("OpenSSL can't write a private key");
  }
  const std::string text = TextOf(bio.get());
  const std::string draft = absl::StrCat(path, ".draft-", getpid());
  unlink(draft.c_str());
  const Fd file(open(draft.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  const bool good = file.valid() && write(file.get(), text.data(), text.size()) ==
                                        std::ssize(text) && fsync(file.get()) == 0 &&
                    (link(draft.c_str(), path.c_str()) == 0 || errno == EEXIST);
  const int error = errno;
  unlink(draft.c_str());
  if (good) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat(path, ": the signing key can't be written: ", std::strerror(error)));
}

}  // namespace

void KeyDeleter::operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }

absl::StatusOr<SigningKey> SigningKey::LoadOrMake(const std::string& path) {
  if (access(path.c_str(), F_OK) != 0 && errno == ENOENT) {
    const KeyPtr made(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"));
    if (made == nullptr) return absl::InternalError("OpenSSL can't make an Ed25519 key");
    if (absl::Status status = Store(made.get(), path); !status.ok()) return status;
  }
  absl::StatusOr<std::string> text = ReadFile(path);
  if (!text.ok()) return absl::InternalError(text.status().message());
  const BioPtr bio(BIO_new_mem_buf(text->data(), static_cast<int>(text->size())), BIO_free);
  KeyPtr key(PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr));
  if (key == nullptr || EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519) {
    return absl::InternalError(absl::StrCat(path, ": holds no Ed25519 private key in PEM"));
  }
  return SigningKey(std::move(key));
}

absl::StatusOr<std::string> SigningKey::Sign(std::string_view message) const {
  const ContextPtr context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  unsigned char signature[kSignatureBytes];
  size_t size = sizeof(signature);
  if (EVP_DigestSignInit(context.get(), nullptr, nullptr, nullptr, key_.get()) != 1 ||
      EVP_DigestSign(context.get(), signature, &size,
                     reinterpret_cast<const unsigned char*>(message.data()),
                     message.size()) != 1) {
    return absl::InternalError("OpenSSL can't sign with the receipts' key");
  }
  return HexOf({signature, size});
}

std::string SigningKey::PublicPem() const {
  const BioPtr bio(BIO_new(BIO_s_mem()), BIO_free);
  PEM_write_bio_PUBKEY(bio.get(), key_.get());
  return TextOf(bio.get());
}

absl::StatusOr<PublicKey> PublicKey::Read(const std::string& path) {
  absl::StatusOr<std::string> text = ReadFile(path);
  if (!text.ok()) return text.status();
  return Parse(*text, path);
}

absl::StatusOr<PublicKey> PublicKey::Parse(const std::string& pem, const std::string& where) {
  const BioPtr bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())), BIO_free);
  KeyPtr key(PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr));
  if (key == nullptr || EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519) {
    return absl::InvalidArgumentError(absl::StrCat(
        where, ": holds no Ed25519 public key in PEM; \"myograde key\" prints the organiser's"));
  }
  return PublicKey(std::move(key));
}

bool PublicKey::Verify(std::string_view message, const std::string& signature) const {
  if (signature.size() != 2 * kSignatureBytes ||
      signature.find_first_not_of("0123456789abcdef") != std::string::npos) {
    return false;
  }
  const std::string bytes = absl::HexStringToBytes(signature);
  const ContextPtr context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  return EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, key_.get()) == 1 &&
         EVP_DigestVerify(context.get(), reinterpret_cast<const unsigned char*>(bytes.data()),
                          bytes.size(), reinterpret_cast<const unsigned char*>(message.data()),
                          message.size()) == 1;
}

}  // namespace myograde::server
