#include "protocol/lease/track_config_forms.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/tracks/registry.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

// Form 1 is the first, without "form". A step sets each new key to the value that means what the
// earlier form did without it; tracks do the same for their own keys (TrackKind::upgrade).
void FromForm1(Json& config) {
  config["form"] = 2;
  if (const auto it = config.find("budgets"); it != config.end() && it->is_object()) {
    // No separate bound: the whole lease's time.
    if (it->contains("lease_wall_s")) (*it)["lease_idle_s"] = (*it)["lease_wall_s"];
    // Form 1 counted all of the start-up's wall time.
    if (it->contains("startup_s")) (*it)["startup_wall_s"] = (*it)["startup_s"];
  }
  config.emplace("policy_seed_secret", nullptr);  // seeds from the data folder's own secret
}

using Step = void (*)(Json&);
constexpr Step kSteps[] = {FromForm1};  // the n-th leads from form n to n + 1
static_assert(std::size(kSteps) + 1 == kTrackConfigForm);

}  // namespace

absl::StatusOr<Json> UpgradeTrackConfig(Json effective, const std::string& where) {
  if (!effective.is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": must be a JSON object"));
  }
  int64_t form = 1;
  if (const auto it = effective.find("form"); it != effective.end()) {
    if (!it->is_number_integer() || it->get<int64_t>() < 1) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": \"form\" must be a whole number from 1 to ", kTrackConfigForm));
    }
    form = it->get<int64_t>();
  }
  if (form > kTrackConfigForm) {
    return absl::FailedPreconditionError(
        absl::StrCat(where, ": is a track config of form ", form, ", this build knows forms up to ",
                     kTrackConfigForm, "; use a newer build"));
  }
  const Json name = effective.value("track", Json());
  const TrackKind* track = name.is_string() ? FindTrack(name.get<std::string>()) : nullptr;
  for (; form < kTrackConfigForm; ++form) {
    kSteps[form - 1](effective);
    if (track != nullptr && track->upgrade != nullptr) track->upgrade(form, effective);
  }
  return effective;
}

}  // namespace myograde
