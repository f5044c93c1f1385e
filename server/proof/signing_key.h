// Ed25519 keys for receipts and releases, through OpenSSL.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/mutex.h"

typedef struct evp_pkey_st EVP_PKEY;

namespace myograde::server {

struct KeyDeleter {
  void operator()(EVP_PKEY* key) const;
};
using KeyPtr = std::unique_ptr<EVP_PKEY, KeyDeleter>;

// The organiser's private key, which signs receipts.
class SigningKey {
 public:
  // Reads the private key in `path`, or creates one that only its owner may read. Any number of
  // threads and processes may call this at once, and may be killed during it. An existing file is
  // never replaced, even if it is broken. Errors name the file.
  static absl::StatusOr<SigningKey> LoadOrMake(const std::string& path);

  // Reads the private key in `path`, and makes none. NotFoundError if it can't be opened,
  // InvalidArgumentError if it has no Ed25519 private key in PEM.
  static absl::StatusOr<SigningKey> Read(const std::string& path);

  // The signature of `message`, as 128 hexadecimal digits.
  absl::StatusOr<std::string> Sign(std::string_view message) const;
  // {"signature": {"algorithm": "ed25519", "value": "…"}, WHAT: content}, signed in its canonical form.
  absl::StatusOr<nlohmann::json> SignJson(const char* what, nlohmann::json content) const;

  // The public key as PEM, for publishing.
  std::string PublicPem() const;

 private:
  explicit SigningKey(KeyPtr key) : key_(std::move(key)) {}
  KeyPtr key_;
};

// Caches the organiser's key file, for a program that uses it repeatedly. Thread-safe.
class KeyFile {
 public:
  explicit KeyFile(std::string path) : path_(std::move(path)) {}

  // The key, from SigningKey::LoadOrMake; once loaded it never changes. After an error the file is
  // read again, so that a restored key works.
  absl::StatusOr<std::shared_ptr<const SigningKey>> Get();

 private:
  const std::string path_;
  Mutex mutex_;
  std::shared_ptr<const SigningKey> key_ ABSL_GUARDED_BY(mutex_);
};

// A published public key, which verifies receipts.
class PublicKey {
 public:
  // InvalidArgumentError if the file has no Ed25519 public key in PEM.
  static absl::StatusOr<PublicKey> Read(const std::string& path);
  static absl::StatusOr<PublicKey> Parse(const std::string& pem, const std::string& where);

  // `signature`: as returned by Sign.
  bool Verify(std::string_view message, const std::string& signature) const;
  // Whether `json` is what SignJson made, with nothing added.
  bool IsSigned(const char* what, const nlohmann::json& json) const;

 private:
  explicit PublicKey(KeyPtr key) : key_(std::move(key)) {}
  KeyPtr key_;
};

}  // namespace myograde::server
