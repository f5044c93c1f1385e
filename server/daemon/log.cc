#include "server/daemon/log.h"

#include <memory>

#include <absl/time/time.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

namespace myograde::server {
namespace {

// The logger is synchronous, so this runs on the thread whose fields count.
class LineFormatter : public spdlog::formatter {
 public:
  explicit LineFormatter(LogFormat format) : format_(format) {}

  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) override {
    const spdlog::string_view_t level = spdlog::level::to_string_view(message.level);
    const std::string line =
        LogLine(format_, absl::FromChrono(message.time), {level.data(), level.size()},
                {message.payload.data(), message.payload.size()}, CurrentLogFields());
    to.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<LineFormatter>(format_);
  }

 private:
  const LogFormat format_;
};

}  // namespace

void StartLog(const std::string& level, LogFormat format) {
  auto log = spdlog::stderr_logger_mt("myograded");
  log->set_formatter(std::make_unique<LineFormatter>(format));
  log->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(log));
}

}  // namespace myograde::server
