// Tars with valid checksums and arbitrary entries: the input chooses types, names, links, modes and
// sizes, so that the rules of submissions are reached, not only libarchive's checks.
#include "tests/fuzz/archive_checks.h"
#include "tests/server/artefact/raw_tar.h"

namespace {

using myograde::fuzz::Input;
using myograde::server::TarEntry;
using myograde::server::TarHeader;
using myograde::server::TarPadding;

constexpr char kManifest[] = R"({"name": "fuzz", "command": ["./policy"]})";

// Types of POSIX and GNU, including sparse files and extended headers.
constexpr std::string_view kTypes = "0125KLxgS34670V";

}  // namespace

MYOGRADE_FUZZ_TARGET(tar)(const uint8_t* data, size_t size) {
  static const myograde::fuzz::Folder folder;
  Input input(data, size);
  std::string tar;
  const uint8_t honest = input.Byte();
  if ((honest & 1) != 0) {
    tar = TarEntry('0', "policy.json", kManifest) + TarEntry('0', "policy", "", "", 0755);
  }
  while (!input.empty()) {
    const char type = kTypes[input.Byte() % kTypes.size()];
    const uint32_t mode = input.Number(2);
    const std::string name = input.Text(input.Byte() % 101);
    const std::string link = input.Text(input.Byte() % 101);
    const std::string content = input.Text(input.Byte());
    // Mostly the true size; otherwise up to 8 GiB that are not there.
    const uint8_t lie = input.Byte();
    const uint64_t claimed = lie < 200 ? content.size() : uint64_t{1} << (lie % 34);
    tar += TarHeader(type, name, link, mode, claimed) + content + TarPadding(content.size());
  }
  if ((honest & 2) != 0) tar.append(2 * myograde::server::kTarBlock, '\0');
  myograde::fuzz::CheckUnpack(folder, tar);
  return 0;
}
