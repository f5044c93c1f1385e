#include "server/cli/base/usage_error.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

#include "server/cli/base/did_you_mean.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

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
