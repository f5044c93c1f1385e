#include "server/proof/signing_key.h"

#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr char kAlgorithm[] = "ed25519";

constexpr size_t kSignatureBytes = 64;
constexpr size_t kMaxPemBytes = 16 << 10;

using BioPtr = std::unique_ptr<BIO, int (*)(BIO*)>;
using ContextPtr = std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)>;

std::string TextOf(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  return std::string(data, static_cast<size_t>(size));
}

// The key in a PEM text; null if there is none.
KeyPtr ParsePrivateKey(const std::string& pem) {
  const BioPtr bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())), BIO_free);
  KeyPtr key(PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr));
  if (key != nullptr && EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519) key = nullptr;
  return key;
}

absl::Status CantWrite(const std::string& path) {
  return absl::UnavailableError(
      absl::StrCat(path, ": the signing key can't be written: ", std::strerror(errno)));
}

// Holds the folder of `path` locked: one process and thread at a time makes a key there.
absl::StatusOr<Fd> LockFolderOf(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  Fd lock(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!lock.valid() || TEMP_FAILURE_RETRY(flock(lock.get(), LOCK_EX)) != 0) return CantWrite(path);
  return lock;
}

// Writes it completely and to disk under another name, then links it to its final one: neither a
// kill nor a full disk leaves half a key there, and an existing key is never replaced.
absl::Status MakeKey(const std::string& path, const std::string& draft, const Fd& folder) {
  const KeyPtr key(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"));
  if (key == nullptr) return absl::InternalError("OpenSSL can't make an Ed25519 key");
  const BioPtr bio(BIO_new(BIO_s_mem()), BIO_free);
  if (PEM_write_bio_PrivateKey(bio.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1) {
    return absl::InternalError("OpenSSL can't write a private key");
  }
  const Fd file(open(draft.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!file.valid()) return CantWrite(path);
  absl::Status status;
  if (!WriteAll(file.get(), TextOf(bio.get())).ok() || fsync(file.get()) != 0 ||
      link(draft.c_str(), path.c_str()) != 0 || fsync(folder.get()) != 0) {
    status = CantWrite(path);
  }
  unlink(draft.c_str());
  return status;
}

}  // namespace

void KeyDeleter::operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }

absl::StatusOr<SigningKey> SigningKey::LoadOrMake(const std::string& path) {
  ASSIGN_OR_RETURN(const Fd folder, LockFolderOf(path));
  const std::string draft = path + ".draft-new";
  unlink(draft.c_str());  // of a process that was killed while it wrote
  if (struct stat info; lstat(path.c_str(), &info) != 0 && errno == ENOENT) {
    RETURN_IF_ERROR(MakeKey(path, draft, folder));
  }
  absl::StatusOr<std::string> text = ReadFile(path, kMaxPemBytes);
  if (absl::IsInvalidArgument(text.status())) text = "";  // nothing that large is a key
  if (!text.ok()) return absl::InternalError(text.status().message());
  KeyPtr key = ParsePrivateKey(*text);
  if (key == nullptr) {
    return absl::InternalError(absl::StrCat(
        path, ": holds no Ed25519 private key in PEM; put your copy of it back, or move the file "
              "away to get a new key, which earlier receipts are not signed with"));
  }
  return SigningKey(std::move(key));
}

absl::StatusOr<SigningKey> SigningKey::Read(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxPemBytes));
  KeyPtr key = ParsePrivateKey(text);
  if (key == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": holds no Ed25519 private key in PEM"));
  }
  return SigningKey(std::move(key));
}

absl::StatusOr<std::shared_ptr<const SigningKey>> KeyFile::Get() {
  const MutexLock lock(mutex_);
  if (key_ == nullptr) {
    ASSIGN_OR_RETURN(SigningKey key, SigningKey::LoadOrMake(path_));
    key_ = std::make_shared<const SigningKey>(std::move(key));
  }
  return key_;
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
  return ToHex({signature, size});
}

std::string SigningKey::PublicPem() const {
  const BioPtr bio(BIO_new(BIO_s_mem()), BIO_free);
  PEM_write_bio_PUBKEY(bio.get(), key_.get());
  return TextOf(bio.get());
}

absl::StatusOr<PublicKey> PublicKey::Read(const std::string& path) {
  ASSIGN_OR_RETURN(std::string text, ReadFile(path, kMaxPemBytes));
  return Parse(text, path);
}

absl::StatusOr<PublicKey> PublicKey::Parse(const std::string& pem, const std::string& where) {
  const BioPtr bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())), BIO_free);
  KeyPtr key(PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr));
  if (key == nullptr || EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519) {
    return absl::InvalidArgumentError(absl::StrCat(
        where, ": holds no Ed25519 public key in PEM; \"myograde proof key\" prints the organiser's"));
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

absl::StatusOr<nlohmann::json> SigningKey::SignJson(const char* what, nlohmann::json content) const {
  ASSIGN_OR_RETURN(std::string signature, Sign(CanonicalJson(content)));
  return nlohmann::json{{what, std::move(content)},
                        {"signature", {{"algorithm", kAlgorithm}, {"value", std::move(signature)}}}};
}

bool PublicKey::IsSigned(const char* what, const nlohmann::json& json) const {
  if (!json.is_object() || json.size() != 2 || !json.contains(what) || !json.contains("signature")) {
    return false;
  }
  const nlohmann::json& signature = json["signature"];
  if (!signature.is_object() || signature.size() != 2 ||
      signature.value("algorithm", nlohmann::json()) != kAlgorithm) {
    return false;
  }
  const nlohmann::json value = signature.value("value", nlohmann::json());
  return value.is_string() && Verify(CanonicalJson(json[what]), value.get<std::string>());
}

}  // namespace myograde::server
