#include "server/api/negotiation.h"

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include "server/api/entity_tag.h"

namespace myograde::server {
namespace {

// A weight in thousandths: 0 to 1 with at most three digits behind the point. 0: it is none.
int WeightOf(absl::string_view text) {
  if (text.empty() || text.size() > 5 || (text[0] != '0' && text[0] != '1')) return 0;
  int weight = 1000 * (text[0] - '0');
  if (text.size() > 1 && text[1] != '.') return 0;
  for (size_t i = 2, unit = 100; i < text.size(); ++i, unit /= 10) {
    if (!absl::ascii_isdigit(static_cast<unsigned char>(text[i]))) return 0;
    weight += static_cast<int>(unit) * (text[i] - '0');
  }
  return weight > 1000 ? 0 : weight;
}

// What Accept-Encoding gives to each coding that it names, in lower case.
std::map<std::string, int> CodingWeights(const Request& request) {
  std::map<std::string, int> weights;
  const auto [begin, end] = request.headers.equal_range("accept-encoding");
  for (auto it = begin; it != end; ++it) {
    for (const absl::string_view part : absl::StrSplit(it->second, ',')) {
      const std::vector<absl::string_view> words = absl::StrSplit(part, ';');
      int weight = 1000;
      for (size_t at = 1; at < words.size(); ++at) {
        absl::string_view parameter = absl::StripAsciiWhitespace(words[at]);
        if (absl::ConsumePrefix(&parameter, "q=") || absl::ConsumePrefix(&parameter, "Q=")) {
          weight = WeightOf(parameter);
        }
      }
      weights.emplace(absl::AsciiStrToLower(absl::StripAsciiWhitespace(words[0])), weight);
    }
  }
  return weights;
}

}  // namespace

bool TakesCoding(const Request& request, std::string_view coding) {
  const std::map<std::string, int> weights = CodingWeights(request);
  const auto weight_of = [&](const char* name) {
    const auto it = weights.find(name);
    return it == weights.end() ? -1 : it->second;
  };
  int weight = weight_of(std::string(coding).c_str());
  if (weight < 0 && coding == "gzip") weight = weight_of("x-gzip");
  if (weight < 0) weight = weight_of("*");
  return weight > 0 && weight >= weight_of("identity");
}

bool HasCurrent(const Request& request, std::string_view tag) {
  const auto [begin, end] = request.headers.equal_range("if-none-match");
  return std::any_of(begin, end,
                     [&](const auto& header) { return NamesEntityTag(header.second, tag); });
}

}  // namespace myograde::server
