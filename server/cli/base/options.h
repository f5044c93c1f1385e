// Options that several verbs have, and what is wrong with a command line.
#pragma once

#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/cli/base/exit_status.h"

namespace myograde::server {

// A check of options that are whole numbers from `least` on; `what` says in the error what the
// text is not: "no episode".
CLI::Validator WholeNumber(int64_t least, const std::string& what);

// Whether `text` is 1 to `most` letters, digits, ".", "_" and "-", and begins with a letter or a
// digit or, if `any_first`, with any of them.
bool IsSimpleName(const std::string& text, size_t most, bool any_first = false);

// The two numbers of "A..B"; nullopt if it is no such text.
std::optional<std::pair<int64_t, int64_t>> ParseRange(const std::string& text);

// Options that can't be used together: InvalidArgumentError with the first sentence whose condition
// is true.
absl::Status RefuseIf(std::initializer_list<std::pair<bool, std::string>> mistakes);

// Adds --json; the output is described by configs/schema/SCHEMA.json.
void AddJson(CLI::App& verb, const std::string& schema, bool& json,
             const std::string& help = "Print JSON");

// Adds --full-hashes.
void AddFullHashes(CLI::App& verb, bool& full);

// Where the data folder and its socket are. Each takes the value of its option, "" if not given.
std::string DataDir(const std::string& option);  // --data, MYOGRADE_DATA, or the default
std::string SocketPath(const std::string& socket_option, const std::string& data_option);

// Where this host's configs and models are.
struct HostOptions {
  std::string configs;
  std::string cache;

  std::string configs_dir() const;
  std::string cache_dir() const;  // --cache, MYOGRADE_CACHE, or the default
};

// Adds --configs and --cache.
void AddHostOptions(CLI::App& verb, HostOptions& options);

// Adds PATH, or whatever it is called, of a submission.
void AddPolicyPath(CLI::App& verb, const std::string& name, std::string& path);

// The parts of a verb, such as "team create" and "team list", which share their options.
template <typename Options>
class Parts {
 public:
  explicit Parts(CLI::App& verb) : verb_(verb) { verb_.require_subcommand(1); }

  // `example` is what stands behind the verb: "create NAME".
  CLI::App* Add(const std::string& name, const std::string& does, const std::string& example,
                std::function<absl::StatusOr<int>(const Options&)> action) {
    CLI::App* part = verb_.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde ", verb_.get_name(), " ", example));
    part->callback([chosen = chosen_, options = options_, action = std::move(action)] {
      *chosen = [options, action] { return action(*options); };
    });
    return part;
  }

  Options& options() { return *options_; }

  // What the verb does: the part that the command line names.
  Action Chosen() const {
    return [chosen = chosen_] { return (*chosen)(); };
  }

 private:
  CLI::App& verb_;
  std::shared_ptr<Options> options_ = std::make_shared<Options>();
  std::shared_ptr<Action> chosen_ = std::make_shared<Action>();
};

// The candidate that is nearest to `word` by inserted, left out, changed and swapped letters,
// one for three letters at most, or of which `word` is the beginning; "" if none or more
// than one is.
std::string NearestOf(std::string_view word, const std::vector<std::string>& candidates);

// One sentence on `mistake`, which parsing `words` gave, with the verb or option that was
// probably meant or the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& mistake,
                       const std::vector<std::string>& words);

}  // namespace myograde::server
