// What libarchive says about a broken archive, in words that may be shown.
#pragma once

#include <archive.h>

#include <string>

namespace myograde::server {

// libarchive's error message, as part of one line.
std::string ArchiveReason(archive* reader);

}  // namespace myograde::server
