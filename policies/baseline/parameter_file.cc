#include "policies/baseline/parameter_file.h"

#include <fstream>
#include <sstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace myograde::baseline {

WalkerNumbers ReadWalkerNumbers(const std::string& path) {
  std::ifstream file(path);
  const nlohmann::json content = nlohmann::json::parse(file, nullptr, /*allow_exceptions=*/false);
  if (!file || !content.is_object() || !content.contains("parameters")) {
    throw std::runtime_error(path + " is not there, or no JSON object with \"parameters\".");
  }
  const nlohmann::json& parameters = content["parameters"];
  WalkerNumbers numbers{};
  for (size_t i = 0; i < numbers.size(); ++i) {
    const ParameterInfo& info = kWalkerParameters[i];
    const auto found = parameters.find(info.name);
    if (found == parameters.end() || !found->is_number()) {
      throw std::runtime_error(path + ": parameters has no number \"" + info.name + "\".");
    }
    numbers[i] = found->get<double>();
    if (numbers[i] < info.low || numbers[i] > info.high) {
      std::ostringstream sentence;
      sentence << path << ": parameters." << info.name << " is " << numbers[i] << ", must be from "
               << info.low << " to " << info.high << ".";
      throw std::runtime_error(sentence.str());
    }
  }
  return numbers;
}

}  // namespace myograde::baseline
