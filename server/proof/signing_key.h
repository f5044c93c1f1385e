// Ed25519 keys for receipts, through OpenSSL.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"

typedef struct evp_pkey_st EVP_PKEY;

namespace myograde::server {

struct KeyDeleter {
  void operator()(EVP_PKEY* key) const;
};
using KeyPtr = std::unique_ptr<EVP_PKEY, KeyDeleter>;

// The organiser's key: signs receipts.
class SigningKey {
 public:
  // Reads the private key in `path`, or makes one there that only its owner may
  // read. Any number of threads and processes may call it at once, and be killed
  // at it. A file that is there is never replaced, broken or not. Errors name it.
  static absl::StatusOr<SigningKey> LoadOrMake(const std::string& path);

  // The signature of `message`, 128 hexadecimal digits.
  absl::StatusOr<std::string> Sign(std::string_view message) const;

  // The public key as PEM, to be published.
  std::string PublicPem() const;

 private:
  explicit SigningKey(KeyPtr key) : key_(std::move(key)) {}
  KeyPtr key_;
};

// The organiser's key in its file, for a program that uses it again and again.
// Thread-safe.
class KeyFile {
 public:
  explicit KeyFile(std::string path) : path_(std::move(path)) {}

  // The key, by SigningKey::LoadOrMake; once it is there, the same for ever. After an
  // error the file is looked at again, so that a key which was put back serves.
  absl::StatusOr<std::shared_ptr<const SigningKey>> Get();

 private:
  const std::string path_;
  Mutex mutex_;
  std::shared_ptr<const SigningKey> key_ ABSL_GUARDED_BY(mutex_);
};

// A public key that somebody published: checks receipts.
class PublicKey {
 public:
  // InvalidArgumentError if the file holds no Ed25519 public key in PEM.
  static absl::StatusOr<PublicKey> Read(const std::string& path);
  static absl::StatusOr<PublicKey> Parse(const std::string& pem, const std::string& where);

  // `signature`: as Sign gives it.
  bool Verify(std::string_view message, const std::string& signature) const;

 private:
  explicit PublicKey(KeyPtr key) : key_(std::move(key)) {}
  KeyPtr key_;
};

}  // namespace myograde::server
