#include "server/api/negotiation.h"

#include <algorithm>
#include <map>
#include <vector>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/sha256.h"

namespace myograde::server {
namespace {

constexpr std::string_view kSpace = " \t,";

// What Accept-Encoding gives to each coding that it names, in lower case.
std::map<std::string, double> CodingWeights(const Request& request) {
  std::map<std::string, double> weights;
  const auto [begin, end] = request.headers.equal_range("accept-encoding");
  for (auto it = begin; it != end; ++it) {
    for (const absl::string_view part : absl::StrSplit(it->second, ',')) {
      const std::vector<absl::string_view> words = absl::StrSplit(part, ';');
      double weight = 1;
      for (size_t at = 1; at < words.size(); ++at) {
        absl::string_view parameter = absl::StripAsciiWhitespace(words[at]);
        if (!absl::StartsWithIgnoreCase(parameter, "q=")) continue;
        const bool good = absl::SimpleAtod(parameter.substr(2), &weight);
        if (!good || !(weight >= 0 && weight <= 1)) weight = 0;
      }
      weights.emplace(absl::AsciiStrToLower(absl::StripAsciiWhitespace(words[0])), weight);
    }
  }
  return weights;
}

}  // namespace

std::string ComputeEntityTag(std::string_view body) {
  return absl::StrCat("\"", Sha256Hex(body), "\"");
}

bool NamesEntityTag(std::string_view if_none_match, std::string_view tag) {
  std::string_view rest = if_none_match;
  if (rest == "*") return true;
  for (;;) {
    rest.remove_prefix(std::min(rest.find_first_not_of(kSpace), rest.size()));
    if (rest.starts_with("W/")) rest.remove_prefix(2);
    // A tag may have a comma in it, so quotes decide where it ends.
    if (!rest.starts_with('"')) return false;
    const size_t end = rest.find('"', 1);
    if (end == std::string_view::npos) return false;
    if (rest.substr(0, end + 1) == tag) return true;
    rest.remove_prefix(end + 1);
  }
}

bool TakesCoding(const Request& request, std::string_view coding) {
  const std::map<std::string, double> weights = CodingWeights(request);
  const auto weight_of = [&](const char* name) {
    const auto it = weights.find(name);
    return it == weights.end() ? -1 : it->second;
  };
  double weight = weight_of(std::string(coding).c_str());
  if (weight < 0 && coding == "gzip") weight = weight_of("x-gzip");
  if (weight < 0) weight = weight_of("*");
  return weight > 0 && weight >= weight_of("identity");
}

bool AnswersWithTag(const Request& request, const std::string& tag, Response& response) {
  response.SetHeader("ETag", tag);
  const auto [begin, end] = request.headers.equal_range("if-none-match");
  const bool current = std::any_of(
      begin, end, [&](const auto& header) { return NamesEntityTag(header.second, tag); });
  if (current) response.status = 304;
  return current;
}

}  // namespace myograde::server
