// Lists all that is in a folder, following no link.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "server/artefact/listing.h"

namespace myograde::server {

// Whose folder it is.
enum class FolderOf {
  kParticipant,  // what breaks a rule of submissions is an InvalidArgumentError that says what to do
  kDaemon,       // a submission that was accepted; what can't be in one is a DataLossError
};

// Adds the entries below `root`, a descriptor, to `listing`; of files, all but the SHA-256. The
// listing's limit bounds the depth.
absl::Status ListFolder(int root, FolderOf whose, Listing& listing);

}  // namespace myograde::server
