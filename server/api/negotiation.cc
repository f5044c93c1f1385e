#include "server/api/negotiation.h"

#include <string>
#include <vector>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include "server/api/entity_tag.h"

namespace myograde::server {

bool TakesCoding(const httplib::Request& request, std::string_view coding) {
  const absl::string_view wanted(coding.data(), coding.size());
  for (size_t i = 0; i < request.get_header_value_count("Accept-Encoding"); ++i) {
    const std::string value = request.get_header_value("Accept-Encoding", i);
    for (const absl::string_view part : absl::StrSplit(value, ',')) {
      const std::vector<absl::string_view> words = absl::StrSplit(part, ';');
      if (!absl::EqualsIgnoreCase(absl::StripAsciiWhitespace(words[0]), wanted)) continue;
      if (words.size() == 1) return true;
      absl::string_view weight = absl::StripAsciiWhitespace(words[1]);
      double number = 0;
      return absl::ConsumePrefix(&weight, "q=") && absl::SimpleAtod(weight, &number) && number > 0;
    }
  }
  return false;
}

bool HasCurrent(const httplib::Request& request, std::string_view tag) {
  for (size_t i = 0; i < request.get_header_value_count("If-None-Match"); ++i) {
    if (NamesEntityTag(request.get_header_value("If-None-Match", i), tag)) return true;
  }
  return false;
}

}  // namespace myograde::server
