#include "server/cli/base/verbs.h"

#include <signal.h>

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_split.h>

#include <algorithm>
#include <filesystem>
#include <iostream>

#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

volatile sig_atomic_t g_stop_requested = 0;

// Of the daemon that a package's units start.
constexpr char kSystemSocket[] = "/run/myograde/myograde.sock";

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

std::vector<std::string> NamesOf(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(sub->get_name());
  }
  return names;
}

// For a word that is not a verb of `app`; `known` is what stands before its verbs ("phase seeds ").
std::string NoVerb(const CLI::App& app, const std::string& known, const std::string& word) {
  const std::string help = absl::StrCat("\"myograde ", known, "--help\"");
  if (word.empty()) return absl::StrCat("no verb given; ", help, " lists them");
  std::string nearest = FindNearest(word, NamesOf(app));
  // "disqualify" is "submission disqualify"; of "list", which several nouns have, none is meant.
  const auto nouns = app.get_subcommands([&](const CLI::App* noun) {
    const std::vector<std::string> verbs = NamesOf(*noun);
    return std::find(verbs.begin(), verbs.end(), word) != verbs.end();
  });
  if (nouns.size() == 1) nearest = absl::StrCat(nouns[0]->get_name(), " ", word);
  return absl::StrCat("there is no verb \"", known, CutText(Sanitized(word), 40), "\"; ",
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
    if (const std::string nearest = FindNearest(name, known); !nearest.empty()) return nearest;
  }
  return "";
}

}  // namespace

int ExitOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kDone;
    case absl::StatusCode::kUnavailable:
      return kUnreachable;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return kWrongUse;
    default:
      return kTrouble;
  }
}

int ReportError(const absl::Status& status) {
  PrintToErrors(absl::StrCat("myograde: error: ", status.message()));
  return ExitOf(status);
}

absl::Status HostStatus(std::string_view what, const absl::Status& status) {
  if (status.ok()) return status;
  const int exit = ExitOf(status);
  const absl::StatusCode code =
      exit == kWrongUse ? status.code() : absl::StatusCode::kInternal;
  return absl::Status(code, absl::StrCat(absl::string_view(what.data(), what.size()),
                                         what.empty() ? "" : ": ", status.message()));
}

absl::StatusOr<int> ExitOfLogError(const absl::Status& status) {
  if (!absl::IsDataLoss(status)) return status;
  ReportError(status);
  return kNoScore;
}

void CatchStopSignals() {
  struct sigaction action = {};
  action.sa_handler = [](int) { g_stop_requested = 1; };  // no SA_RESTART, so that poll returns
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

bool StopRequested() { return g_stop_requested != 0; }

std::string ShownJson(const Json& json) {
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace);
  std::string shown;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    if (c == '\n' || !IsUnsafe(c)) {
      shown.append(text, begin, at - begin);
    } else if (c < 0x10000) {
      absl::StrAppendFormat(&shown, "\\u%04x", static_cast<uint32_t>(c));
    } else {  // as UTF-16, which is how JSON escapes
      const uint32_t above = static_cast<uint32_t>(c) - 0x10000;
      absl::StrAppendFormat(&shown, "\\u%04x\\u%04x", 0xd800 + (above >> 10),
                            0xdc00 + (above & 0x3ff));
    }
  }
  return shown;
}

void PrintJson(const Json& json) { PlainOutput() << ShownJson(json) << std::endl; }

AnswerPrinter Sentence(std::string text, std::string unchanged) {
  return [text = std::move(text), unchanged = std::move(unchanged)](const Json& answer) {
    const bool same = !unchanged.empty() && !answer.value("changed", true);
    std::cout << Filled(answer, same ? unchanged : text) << std::endl;
  };
}

absl::StatusOr<int> PrintAnswer(const absl::StatusOr<Json>& answer, bool json,
                                const AnswerPrinter& print, int exit) {
  if (!answer.ok()) return answer.status();
  if (json) {
    PrintJson(*answer);
  } else {
    print(*answer);
  }
  return exit;
}

CLI::Validator WholeNumber(int64_t least, const std::string& what) {
  return CLI::Validator(
      [least, what](const std::string& text) {
        int64_t number = 0;
        if (absl::SimpleAtoi(text, &number) && number >= least) return std::string();
        return absl::StrCat("\"", CutText(Sanitized(text), 40), "\" is ", what,
                            ": write a whole number from ", least, " on");
      },
      "");
}

bool IsSimpleName(const std::string& text, size_t most, bool any_first) {
  const auto plain = [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-';
  };
  return !text.empty() && text.size() <= most && std::all_of(text.begin(), text.end(), plain) &&
         (any_first || absl::ascii_isalnum(static_cast<unsigned char>(text.front())));
}

std::optional<std::pair<int64_t, int64_t>> ParseRange(const std::string& text) {
  const std::pair<std::string, std::string> ends = absl::StrSplit(text, absl::MaxSplits("..", 1));
  std::pair<int64_t, int64_t> range;
  if (!absl::SimpleAtoi(ends.first, &range.first) ||
      !absl::SimpleAtoi(ends.second, &range.second)) {
    return std::nullopt;
  }
  return range;
}

absl::Status RefuseIf(std::initializer_list<std::pair<bool, std::string>> mistakes) {
  for (const auto& [wrong, sentence] : mistakes) {
    if (wrong) return absl::InvalidArgumentError(sentence);
  }
  return absl::OkStatus();
}

void AddJson(CLI::App& verb, const std::string& schema, bool& json, const std::string& help) {
  verb.add_flag("--json", json, absl::StrCat(help, " (configs/schema/", schema, ".json)"));
}

void AddFullHashes(CLI::App& verb, bool& full) {
  verb.add_flag("--full-hashes", full,
                "Show full hashes, not their first 12 digits (--json always has them in full)");
}

std::string DataDir(const std::string& option) {
  const std::string folder = option.empty() ? EnvironmentVariable("MYOGRADE_DATA") : option;
  return folder.empty() ? DefaultDataDir() : folder;
}

std::string SocketPath(const std::string& socket_option, const std::string& data_option) {
  if (!socket_option.empty()) return socket_option;
  const std::string own = DataDir(data_option) + "/myograde.sock";
  const bool named = !data_option.empty() || !EnvironmentVariable("MYOGRADE_DATA").empty();
  std::error_code error;
  if (named || std::filesystem::exists(own, error)) return own;
  return std::filesystem::exists(kSystemSocket, error) ? kSystemSocket : own;
}

std::string HostOptions::configs_dir() const { return configs.empty() ? ConfigDir() : configs; }

std::string HostOptions::cache_dir() const {
  const std::string folder = cache.empty() ? EnvironmentVariable("MYOGRADE_CACHE") : cache;
  return folder.empty() ? DefaultCacheDir() : std::filesystem::absolute(folder).string();
}

void AddHostOptions(CLI::App& verb, HostOptions& options) {
  verb.add_option("--configs", options.configs,
                  "Folder with tracks/ and server.json (default: MYOGRADE_CONFIG_DIR, else the "
                  "configs shipped with MyoGrade)");
  verb.add_option("--cache", options.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "~/.cache/myograde if it has models, else /var/cache/myograde)");
}

void AddPolicyPath(CLI::App& verb, const std::string& name, std::string& path) {
  verb.add_option(name, path,
                  "An executable file, a folder with a policy.json, an archive of such a folder "
                  "(.tar, .tar.gz, .tar.zst, .zip), or a container image as podman save writes it")
      ->required();
}

Command& Chosen() {
  static Command& chosen = *new Command;
  return chosen;
}

std::string CommandOf(const CLI::App& verb) {
  const CLI::App* parent = verb.get_parent();
  return parent == nullptr ? verb.get_name()
                           : absl::StrCat(CommandOf(*parent), " ", verb.get_name());
}

std::string FindNearest(std::string_view word, const std::vector<std::string>& candidates) {
  if (word.empty() || word.size() > kLongestWord) return "";
  size_t least = std::max<size_t>(1, word.size() / 3);
  std::vector<std::string> nearest;
  std::vector<std::string> begun;
  for (const std::string& candidate : candidates) {
    const size_t distance = Distance(word, candidate);
    if (distance < least) nearest.clear();
    least = std::min(least, distance);
    if (distance == least) nearest.push_back(candidate);
    if (candidate.starts_with(word)) begun.push_back(candidate);
  }
  const std::vector<std::string>& found = nearest.empty() ? begun : nearest;
  return found.size() == 1 ? found[0] : "";
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
