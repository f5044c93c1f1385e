#include "server/store/damage.h"

#include <set>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/mutex.h"
#include "server/base/error_code.h"

namespace myograde::server {
namespace {

constexpr char kPayload[] = "myograde/damaged-row";
constexpr char kCorrupt[] = "myograde/corrupt-store";

}  // namespace

std::string DamageText(const Damage& damage) {
  return absl::StrCat(damage.table, " ", damage.key, " of the store can't be read: ", damage.what,
                      "; restore the store from a backup, or go on without it");
}

absl::Status DamagedRow(const Damage& damage) {
  absl::Status status = absl::DataLossError(DamageText(damage));
  const nlohmann::json parts = {damage.table, damage.key, damage.what};
  status.SetPayload(kPayload, absl::Cord(parts.dump(-1, ' ', /*ensure_ascii=*/false,
                                                    nlohmann::json::error_handler_t::replace)));
  return WithErrorCode(status, kDamagedRowCode);
}

std::optional<Damage> ExtractDamage(const absl::Status& status) {
  const auto payload = status.GetPayload(kPayload);
  if (!payload) return std::nullopt;
  const auto parts = nlohmann::json::parse(std::string(*payload));
  return Damage{parts[0], parts[1], parts[2]};
}

bool IsLeftOut(const absl::Status& status) {
  constexpr size_t kMostKept = 1000;
  static Mutex mutex;
  static std::set<std::string>& said = *new std::set<std::string>;
  if (!ExtractDamage(status).has_value()) return false;
  const std::string text(status.message());
  const MutexLock lock(mutex);
  if (said.size() < kMostKept && said.insert(text).second) spdlog::error("{}", text);
  return true;
}

bool MayPass(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsResourceExhausted(status) ||
         absl::IsPermissionDenied(status);
}

bool IsBrokenStore(const absl::Status& status) {
  return absl::IsDataLoss(status) && !ExtractDamage(status).has_value();
}

bool IsCorruptStore(const absl::Status& status) { return status.GetPayload(kCorrupt).has_value(); }

absl::Status CorruptStore(const std::string& message) {
  absl::Status status = absl::DataLossError(message);
  status.SetPayload(kCorrupt, absl::Cord());
  return status;
}

}  // namespace myograde::server
