#include "server/cli/offline/secret_source.h"

#include <unistd.h>

#include <nlohmann/json.hpp>

#include "protocol/base/file.h"
#include "server/cli/client/challenges.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxSecretFileBytes = 4096;

}  // namespace

absl::StatusOr<std::string> ReadPhaseSecret(const std::string& path) {
  const absl::StatusOr<std::string> text = ReadFile(path, kMaxSecretFileBytes);
  return text.ok() ? SecretOfDigits(*text, path) : text;
}

absl::StatusOr<std::string> GivenSecret(const std::string& digits_or_path) {
  const bool file = ::access(digits_or_path.c_str(), R_OK) == 0;
  return file ? ReadPhaseSecret(digits_or_path) : SecretOfDigits(digits_or_path, "--secret");
}

std::optional<std::string> RevealedSecret(const Client& client, const std::string& phase) {
  const absl::StatusOr<Json> answer = client.Get("/v1/challenges");
  if (!answer.ok()) return std::nullopt;
  const Json known = PhaseIn(*answer, phase);
  if (!known.is_object()) return std::nullopt;
  const Json told = known.value("seeds", Json::object()).value("secret", Json());
  if (!told.is_string()) return std::nullopt;
  absl::StatusOr<std::string> secret =
      SecretOfDigits(told.get<std::string>(), "the daemon's answer");
  if (!secret.ok()) return std::nullopt;
  return *std::move(secret);
}

}  // namespace myograde::server
