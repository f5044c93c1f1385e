// Any bytes as an archive: tar, tar.gz, tar.zst, zip or none of these.
#include "tests/fuzz/archive_checks.h"

MYOGRADE_FUZZ_TARGET(archive)(const uint8_t* data, size_t size) {
  static const myograde::fuzz::Folder folder;
  myograde::fuzz::CheckUnpack(folder, {reinterpret_cast<const char*>(data), size});
  return 0;
}
