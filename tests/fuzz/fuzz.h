// Shared by the fuzz targets. A target is one file with a function of its name:
//
//   MYOGRADE_FUZZ_TARGET(frame)(const uint8_t* data, size_t size) { ...; return 0; }
//
// libFuzzer runs it on mutations in a separate program (preset `fuzz`); in every other build
// replay_main.cc runs all targets on the files of their corpora.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <span>
#include <string>
#include <string_view>

namespace myograde::fuzz {

// Aborts the process, which libFuzzer reports, unless `holds`.
inline void Require(bool holds, std::string_view property) {
  if (holds) return;
  std::fprintf(stderr, "property broken: %.*s\n", static_cast<int>(property.size()),
               property.data());
  std::abort();
}

// Consumes an input from its front. Past the end every read returns zeros.
class Input {
 public:
  Input(const uint8_t* data, size_t size) : rest_(data, size) {}

  bool empty() const { return rest_.empty(); }

  uint8_t Byte() {
    if (rest_.empty()) return 0;
    const uint8_t byte = rest_.front();
    rest_ = rest_.subspan(1);
    return byte;
  }

  // Big-endian, so that a corpus can be read in a hex dump.
  uint32_t Number(int bytes) {
    uint32_t number = 0;
    for (int i = 0; i < bytes; ++i) number = number << 8 | Byte();
    return number;
  }

  // The next `size` bytes, or what is left of them.
  std::span<const std::byte> Bytes(size_t size) {
    const auto taken = std::as_bytes(rest_.first(std::min(size, rest_.size())));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }

  std::string Text(size_t size) {
    const auto bytes = Bytes(size);
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  std::span<const std::byte> Rest() { return Bytes(rest_.size()); }
  std::string RestText() { return Text(rest_.size()); }

 private:
  std::span<const uint8_t> rest_;
};

// A folder of this process, in memory where the host has /dev/shm; removed at exit. Not copyable.
class Folder {
 public:
  Folder() {
    std::error_code error;
    const std::filesystem::path base =
        std::filesystem::is_directory("/dev/shm", error) ? std::filesystem::path("/dev/shm")
                                                         : std::filesystem::temp_directory_path();
    std::string name = (base / "myograde-fuzz.XXXXXX").string();
    Require(mkdtemp(name.data()) != nullptr, "a temporary folder can be made");
    path_ = name;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::string operator/(const std::string& name) const { return (path_ / name).string(); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline void WriteFile(const std::string& path, std::string_view content) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  Require(file.good(), "a temporary file can be written");
}

using Target = int (*)(const uint8_t* data, size_t size);

// The linked targets, by name.
inline std::map<std::string, Target>& Targets() {
  static std::map<std::string, Target> targets;
  return targets;
}

}  // namespace myograde::fuzz

#if defined(MYOGRADE_FUZZ_REPLAY)
#define MYOGRADE_FUZZ_TARGET(name)                                                        \
  static int Fuzz_##name(const uint8_t* data, size_t size);                               \
  [[maybe_unused]] static const bool fuzz_##name##_listed =                               \
      ::myograde::fuzz::Targets().emplace(#name, Fuzz_##name).second;                     \
  static int Fuzz_##name
#else
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
#define MYOGRADE_FUZZ_TARGET(name) extern "C" int LLVMFuzzerTestOneInput
#endif
