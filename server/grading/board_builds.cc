#include "server/grading/board_builds.h"

#include <algorithm>
#include <map>
#include <utility>

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"

namespace myograde::server {
namespace {

constexpr size_t kBuildDigits = 12;

}  // namespace

std::string SimulatingBuild(std::string_view grader_json) {
  const nlohmann::json grader = nlohmann::json::parse(grader_json, nullptr, false);
  if (!grader.is_object()) return "";
  nlohmann::json parts = nlohmann::json::object();
  for (const char* part : {"simulator", "mujoco", "models"}) {
    parts[part] = grader.value(part, nlohmann::json());
  }
  return Sha256Hex(CanonicalJson(parts)).substr(0, kBuildDigits);
}

BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders) {
  BoardBuilds builds;
  std::map<std::string, std::string, std::less<>> known;  // boards have many rows of few builds
  std::map<std::string, std::pair<size_t, int64_t>> found;
  for (size_t i = 0; i < graders.size(); ++i) {
    auto it = known.find(graders[i]);
    if (it == known.end()) it = known.emplace(graders[i], SimulatingBuild(graders[i])).first;
    auto& [rows, newest] = found[it->second];
    ++rows;
    newest = std::max(newest, evaluations[i]);
    builds.of_rows.push_back(it->second);
  }
  for (const auto& [build, count] : found) builds.counts.push_back({build, count.first});
  std::sort(builds.counts.begin(), builds.counts.end(), [&](const auto& a, const auto& b) {
    return found[a.build] > found[b.build];
  });
  return builds;
}

}  // namespace myograde::server
