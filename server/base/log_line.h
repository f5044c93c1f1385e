// Lines of the daemon's log, as text for people or as JSON for programs. What participants sent may
// be in a message (a team's name, what a policy printed), so everything that could end a line, or
// make a terminal show something else, is escaped: nobody can forge a line.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/time/time.h>

namespace myograde::server {

enum class LogFormat { kText, kJson };

// What a line is about; 0 and "" are left out. Only JSON has it apart from the message.
struct LogFields {
  int64_t evaluation = 0;
  int64_t submission = 0;
  int64_t lease = 0;
  int64_t attempt = 0;
  int64_t delivery = 0;
  std::string team = "";
  std::string webhook = "";
};

// While this object lives, what this thread logs is about `fields`, and nothing else. Scopes may
// nest.
class LogScope {
 public:
  explicit LogScope(LogFields fields);
  ~LogScope();
  LogScope(const LogScope&) = delete;
  LogScope& operator=(const LogScope&) = delete;

 private:
  const LogFields fields_;
  const LogFields* const before_;
};
// Of the innermost scope of this thread.
const LogFields& CurrentLogFields();

// One line with its line feed. As text:
//   2026-12-01T12:00:00.123+0000 info evaluation 9: done
// As JSON: {"time": ..., "level": ..., "message": ..., and the fields}, in ASCII, times in UTC.
std::string LogLine(LogFormat format, absl::Time time, std::string_view level,
                    std::string_view message, const LogFields& fields = {});

}  // namespace myograde::server
