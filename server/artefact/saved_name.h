// The name of a container image, as its archive tells it.
#pragma once

#include <string>

#include "server/artefact/artefact.h"

namespace myograde::server {

// The name of a policy that was saved by this tag: "registry/name:latest" is "name". `tag` is not "".
std::string NameOfTag(const std::string& tag);

// The name that the image `file`, an archive, compressed at most once, was saved by, as a policy's;
// that of `otherwise` if it tells none. Reads the archive up to where it does, and no more than an
// image within `limits` can have.
std::string SavedName(int file, const std::string& otherwise, const ArtefactLimits& limits);

}  // namespace myograde::server
