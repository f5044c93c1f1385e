// Runs a fuzz target over files, without libFuzzer:
//   fuzz_replay TARGET FILE|FOLDER ...
// A broken property or a sanitizer's report ends the process; the last file named on standard error
// is the one that caused it.
#include <algorithm>
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
  for (int i = 2; i < argc; ++i) {
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

// The whole input and, for a short one, all of its prefixes.
void Replay(myograde::fuzz::Target target, const std::string& bytes) {
  constexpr size_t kCutUpTo = 64;
  const auto* data = reinterpret_cast<const uint8_t*>(bytes.data());
  target(data, bytes.size());
  for (size_t size = 0; size < bytes.size() && bytes.size() <= kCutUpTo; ++size) {
    target(data, size);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const auto& targets = myograde::fuzz::Targets();
  const auto target = targets.find(argc > 1 ? argv[1] : "");
  const std::vector<std::string> files = FilesOf(argc, argv);
  if (target == targets.end() || files.empty()) {
    std::fprintf(stderr, "usage: %s TARGET FILE|FOLDER ...  (%s)\ntargets:", argv[0],
                 target == targets.end() ? "no such target" : "no file found");
    for (const auto& [name, unused] : targets) std::fprintf(stderr, " %s", name.c_str());
    std::fprintf(stderr, "\n");
    return 2;
  }
  for (const std::string& path : files) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      std::fprintf(stderr, "%s: can't be read\n", path.c_str());
      return 2;
    }
    std::fprintf(stderr, "%s\n", path.c_str());
    Replay(target->second, {std::istreambuf_iterator<char>(file), {}});
  }
  std::fprintf(stderr, "%zu files, nothing broken\n", files.size());
  return 0;
}
