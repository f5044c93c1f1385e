// What a participant submits: a policy.json, or a container image, which is told from other archives,
// named and unpacked. Internal to the artefact's library.
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct SubmittedManifest {
  PolicyManifest manifest;
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

// Checks a manifest by itself, without the files. Its "image" is an object (ManifestToJson).
absl::StatusOr<PolicyManifest> ParseManifest(const nlohmann::json& json);

// Whether a file is the archive of an image, compressed at most once, and not of an ordinary
// submission. Ordinary ones are told by their first header.
bool IsImageArchive(int file, int folder, const ArtefactLimits& limits);

// The same without a folder to decompress into: a compressed archive is judged by its first names.
bool MayBeImageArchive(int file);

// Unpacks the image `file` into the empty `folder`, as image/ and a policy.json that holds all of
// its config that matters. `manifest`: the submission's own policy.json, an object; a name and a
// command that it lacks are the image's. Checks all digests and sizes that the image states.
// Errors as of UnpackOpened.
absl::StatusOr<Artefact> UnpackImage(int file, int folder, nlohmann::json manifest,
                                     const ArtefactLimits& limits);

// The part of a file's name that is allowed in a policy's name.
std::string PolicyNameOf(const std::string& file);

// The name of a policy that was saved by this tag: "registry/name:latest" is "name". `tag` is not
// "".
std::string NameOfTag(const std::string& tag);

// The name that the image `file`, an archive, compressed at most once, was saved by, as a policy's;
// that of `otherwise` if it tells none. Reads the archive up to where it does, and no more than an
// image within `limits` can have.
std::string SavedName(int file, const std::string& otherwise, const ArtefactLimits& limits);

}  // namespace myograde::server
