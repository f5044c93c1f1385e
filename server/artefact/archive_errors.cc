#include "server/artefact/archive_errors.h"

namespace myograde::server {

std::string ArchiveReason(archive* reader) {
  const char* text = archive_error_string(reader);
  std::string reason = text != nullptr ? std::string(text).substr(0, 200) : "unreadable";
  for (char& c : reason) {
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) >= 0x7f) c = ' ';
  }
  reason.erase(reason.find_last_not_of(' ') + 1);
  return reason;
}

}  // namespace myograde::server
