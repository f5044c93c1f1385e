// Turns the archive of a container image into an artefact.
#pragma once

#include <functional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/artefact/artefact.h"

namespace myograde::server {

// Whether a file is the archive of an image, compressed at most once, and not of an ordinary
// submission. Ordinary ones are told by their first header.
bool IsImageArchive(int file, int folder, const ArtefactLimits& limits);

// The same without a folder to decompress into: a compressed archive is judged by its first names.
bool MayBeImageArchive(int file);

// Unpacks the image `file` into the empty `folder`, as image/ and a policy.json that holds all of
// its config that matters. `manifest`: the submission's own policy.json, an object; a name and a
// command that it lacks are the image's. Checks all digests and sizes that the image states.
// `read` is called now and then. Errors as of UnpackOpened.
absl::StatusOr<Artefact> UnpackImage(int file, int folder, nlohmann::json manifest,
                                     const ArtefactLimits& limits,
                                     const std::function<void()>& read);

}  // namespace myograde::server
