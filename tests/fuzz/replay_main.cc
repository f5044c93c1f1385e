// Runs a fuzz target over files, where there is no libFuzzer:
//   fuzz_TARGET FILE|FOLDER ...
// A broken property or a sanitizer's finding ends the process; the last file
// named on standard error is the one that did it.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz.h"

namespace {

namespace fs = std::filesystem;

std::vector<std::string> FilesOf(int argc, char** argv) {
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    if (!fs::is_directory(argv[i])) {
      files.emplace_back(argv[i]);
      continue;
    }
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(argv[i])) {
      if (entry.is_regular_file()) files.push_back(entry.path().string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

// The whole input and, of a short one, everything that is cut off somewhere.
void Replay(const std::string& bytes) {
  constexpr size_t kCutUpTo = 64;
  const auto* data = reinterpret_cast<const uint8_t*>(bytes.data());
  LLVMFuzzerTestOneInput(data, bytes.size());
  for (size_t size = 0; size < bytes.size() && bytes.size() <= kCutUpTo; ++size) {
    LLVMFuzzerTestOneInput(data, size);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> files = FilesOf(argc, argv);
  if (files.empty()) {
    std::fprintf(stderr, "usage: %s FILE|FOLDER ...  (no file found)\n", argv[0]);
    return 2;
  }
  for (const std::string& path : files) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      std::fprintf(stderr, "%s: can't be read\n", path.c_str());
      return 2;
    }
    std::fprintf(stderr, "%s\n", path.c_str());
    Replay({std::istreambuf_iterator<char>(file), {}});
  }
  std::fprintf(stderr, "%zu files, nothing broken\n", files.size());
  return 0;
}
