// The forms that track configs have had. A config is kept as it was written, in stores,
// receipts, logs and lease orders, and its hash is of those bytes; it is read by the form
// that it names ("form"; configs without it are of form 1), with what that form meant.
//
// Whoever adds, removes or changes a key of a track config adds it to the newest step of
// track_config_forms.cc, so that a config of every earlier form keeps its meaning; a test holds
// it against tests/protocol/lease/forms, whose meaning.json says it too. Forms that have been released
// are never changed.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde {

// The form of the configs in configs/tracks.
inline constexpr int64_t kTrackConfigForm = 2;

// The same config in the keys of kTrackConfigForm. `where` names it in errors.
// FailedPreconditionError: its form is newer than this build. InvalidArgumentError: it is
// no object, or "form" is no whole number from 1 on. Other mistakes are the parser's to find.
absl::StatusOr<nlohmann::json> UpgradeTrackConfig(nlohmann::json effective,
                                                  const std::string& where);

}  // namespace myograde
