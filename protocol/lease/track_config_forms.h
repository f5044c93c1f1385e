// The forms (versions) of track configs. Stores, receipts, logs and lease orders keep a config as
// it was written, and its hash covers those bytes; it is read with the meaning of the form that it
// names ("form"; configs without it are of form 1).
//
// Whoever adds, removes or changes a key of a track config must extend the newest step of
// track_config_forms.cc, so that a config of every earlier form keeps its meaning; a test compares
// with tests/protocol/lease/forms, whose meaning.json must be extended too. Released forms never
// change.
//
// Keys of a file that are no part of the effective config need no new form: "extends", "profiles",
// "default_profile" and "practice_seeds" stand in files of every form and are never stored.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde {

// The form of the configs in configs/tracks.
inline constexpr int64_t kTrackConfigForm = 2;

// Converts a config to the keys of kTrackConfigForm. `where` names it in errors.
// FailedPreconditionError: its form is newer than this build. InvalidArgumentError: it is not an
// object, or "form" is not a whole number from 1 on. Other mistakes are left to the parser.
absl::StatusOr<nlohmann::json> UpgradeTrackConfig(nlohmann::json effective,
                                                  const std::string& where);

}  // namespace myograde
