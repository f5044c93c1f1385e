// A policy.json as a participant writes it. Internal to the artefact's library.
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct SubmittedManifest {
  ArtefactManifest manifest;
  std::string image_file;  // the image's archive, beside policy.json; "": an ordinary submission
  nlohmann::json json;     // the whole object
};

// Reads and checks the policy.json of a folder: no unknown keys, and a command that exists and is
// executable. A command outside the submission is not checked here (see server/sandbox/program.h).
// `name` takes the place of its name, unless it is "". InvalidArgumentError otherwise.
absl::StatusOr<SubmittedManifest> ReadSubmittedManifest(int folder, const std::string& name = "");

// Unpacks the files of an archive as UnpackArtefact does, but does not look at policy.json, and leaves
// the archive of an image as it is.
absl::Status UnpackSubmission(const std::string& archive, const std::string& destination,
                              const ArtefactLimits& limits, const ByteProgress& progress);

// Checks a manifest without "image" by itself, without the files.
absl::StatusOr<ArtefactManifest> ParseManifest(const nlohmann::json& json);

}  // namespace myograde::server
