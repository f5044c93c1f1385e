#include "server/cli/base/usage_error.h"

#include <absl/strings/str_cat.h>

#include <algorithm>
#include <cstddef>

#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr size_t kLongestWord = 64;

// Insertions, omissions, changes and swaps of neighbours that lead from one to the other.
size_t Distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<size_t>> steps(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) {
    for (size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        steps[i][j] = i + j;
        continue;
      }
      const size_t change = a[i - 1] == b[j - 1] ? 0 : 1;
      steps[i][j] =
          std::min({steps[i - 1][j] + 1, steps[i][j - 1] + 1, steps[i - 1][j - 1] + change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        steps[i][j] = std::min(steps[i][j], steps[i - 2][j - 2] + 1);
      }
    }
  }
  return steps[a.size()][b.size()];
}

// The only one of `candidates` for which `fits`; "" if there is none, or another.
template <typename Fits>
std::string OnlyOne(const std::vector<std::string>& candidates, const Fits& fits) {
  std::string found;
  for (const std::string& candidate : candidates) {
    if (!fits(candidate)) continue;
    if (!found.empty()) return "";
    found = candidate;
  }
  return found;
}

std::vector<std::string> NamesOf(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(sub->get_name());
  }
  return names;
}

// For a word that is no verb of `app`; `known` is what stands before its verbs ("seeds ").
std::string NoVerb(const CLI::App& app, const std::string& known, const std::string& word) {
  const std::string help = absl::StrCat("\"myograde ", known, "--help\"");
  if (word.empty()) return absl::StrCat("no verb is given; ", help, " lists them");
  const std::string nearest = NearestOf(word, NamesOf(app));
  return absl::StrCat("there is no verb \"", known, CutText(Harmless(word), 40), "\"; ",
                      nearest.empty() ? absl::StrCat(help, " lists them")
                                      : absl::StrCat("did you mean \"", known, nearest, "\"?"));
}

// For an option that `verb` does not have, the one that it was meant to be; "" if none is near.
std::string OptionMeant(const CLI::App& verb, const std::vector<std::string>& words) {
  std::vector<std::string> known;
  for (const CLI::Option* option : verb.get_options()) {
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  }
  for (const std::string& word : words) {
    const std::string name = word.substr(0, word.find('='));
    if (!name.starts_with("--") || std::find(known.begin(), known.end(), name) != known.end()) {
      continue;
    }
    if (const std::string nearest = NearestOf(name, known); !nearest.empty()) return nearest;
  }
  return "";
}

}  // namespace

std::string NearestOf(std::string_view word, const std::vector<std::string>& candidates) {
  if (word.empty() || word.size() > kLongestWord) return "";
  size_t least = std::max<size_t>(1, word.size() / 3) + 1;
  for (const std::string& candidate : candidates) {
    least = std::min(least, Distance(word, candidate));
  }
  if (least <= std::max<size_t>(1, word.size() / 3)) {
    return OnlyOne(candidates, [&](const std::string& c) { return Distance(word, c) == least; });
  }
  return OnlyOne(candidates, [&](const std::string& c) { return c.starts_with(word); });
}

std::string UsageError(const CLI::App& app, const CLI::ParseError& mistake,
                       const std::vector<std::string>& words) {
  const auto plain = [](const std::string& word) { return !word.starts_with('-'); };
  const CLI::App* verb = &app;
  std::string known;
  auto word = std::find_if(words.begin(), words.end(), plain);
  while (!NamesOf(*verb).empty()) {
    const std::vector<CLI::App*> chosen = verb->get_subcommands();
    if (chosen.empty()) return NoVerb(*verb, known, word == words.end() ? "" : *word);
    verb = chosen[0];
    known += verb->get_name() + " ";
    if (word != words.end()) word = std::find_if(word + 1, words.end(), plain);
  }
  const std::string meant = OptionMeant(*verb, words);
  return absl::StrCat(mistake.what(), "; ",
                      meant.empty() ? absl::StrCat("see \"myograde ", known, "--help\"")
                                    : absl::StrCat("did you mean \"", meant, "\"?"));
}

}  // namespace myograde::server
