#include "policies/baseline/parameter_file.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace myograde::baseline {

std::vector<double> ReadNumbers(const std::string& path, std::span<const ParameterInfo> infos) {
  std::ifstream file(path);
  const nlohmann::json content = nlohmann::json::parse(file, nullptr, /*allow_exceptions=*/false);
  if (!file || !content.is_object() || !content.contains("parameters")) {
    throw std::runtime_error(path + " is not there, or no JSON object with \"parameters\".");
  }
  const nlohmann::json& parameters = content["parameters"];
  std::vector<double> numbers;
  for (const ParameterInfo& info : infos) {
    const auto found = parameters.find(info.name);
    if (found == parameters.end() || !found->is_number()) {
      throw std::runtime_error(path + ": parameters has no number \"" + info.name + "\".");
    }
    const double number = numbers.emplace_back(found->get<double>());
    if (number < info.low || number > info.high) {
      std::ostringstream sentence;
      sentence << path << ": parameters." << info.name << " is " << number << ", must be from "
               << info.low << " to " << info.high << ".";
      throw std::runtime_error(sentence.str());
    }
  }
  return numbers;
}

WalkerNumbers ReadWalkerNumbers(const std::string& path) {
  WalkerNumbers numbers{};
  std::ranges::copy(ReadNumbers(path, kWalkerParameters), numbers.begin());
  return numbers;
}

}  // namespace myograde::baseline
