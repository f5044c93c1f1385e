// A submission's entry as the header of a tar.
#pragma once

#include <memory>
#include <string>

#include <archive_entry.h>

#include "server/artefact/listing.h"

namespace myograde::server {

using TarHeader = std::unique_ptr<archive_entry, void (*)(archive_entry*)>;

// Without an owner, with the mode 0755 or 0644, and the time in whole seconds. Of a file, the size is
// entry.size.
TarHeader MakeTarHeader(const std::string& path, const Entry& entry);

}  // namespace myograde::server
