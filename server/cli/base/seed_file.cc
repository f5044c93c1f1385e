#include "server/cli/base/seed_file.h"

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include <charconv>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxSeedFileBytes = 1 << 20;

absl::StatusOr<std::vector<uint64_t>> SeedsOfLines(const std::string& text,
                                                   const std::string& path) {
  std::vector<uint64_t> seeds;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line.substr(0, line.find('#')));
    if (line.empty()) continue;
    uint64_t seed = 0;
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), seed);
    if (error != std::errc() || end != line.data() + line.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": line ", number,
                       " is no seed; write one whole number from 0 to 2^63-1 on each line"));
    }
    seeds.push_back(seed);
  }
  return seeds;
}

}  // namespace

absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxSeedFileBytes));
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin != std::string::npos && (text[begin] == '[' || text[begin] == '{')) {
    ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, path));
    return ParseSeeds(json, path);
  }
  ASSIGN_OR_RETURN(const std::vector<uint64_t> seeds, SeedsOfLines(text, path));
  return ParseSeeds(nlohmann::json(seeds), path);
}

}  // namespace myograde::server
