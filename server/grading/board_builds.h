// Which build of the grader the rows of a board were played by. Pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

// The first 12 digits of the SHA-256 over what a build simulates with: the simulator, MuJoCo's
// library and the models of an evaluation's grader_json, as canonical JSON. "": it is no JSON object.
std::string SimulatingBuild(std::string_view grader_json);

struct BoardBuilds {
  struct Count {
    std::string build;
    size_t rows = 0;
  };
  std::vector<std::string> of_rows;
  // The board's own first, which most rows are of; of equally many, the one of the newest evaluation.
  std::vector<Count> counts;

  // "": the board is empty.
  std::string own() const { return counts.empty() ? "" : counts.front().build; }
};

// Of rows whose evaluations have these ids and builds.
BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders);

}  // namespace myograde::server
