// What server.json says of webhooks: who is told what.
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// The events, for `events`. A submission's own evaluation ended:
inline constexpr char kFinishedEvent[] = "submission.finished";
inline constexpr char kFailedEvent[] = "submission.failed";
inline constexpr char kCancelledEvent[] = "submission.cancelled";
inline constexpr char kGraderErrorEvent[] = "submission.grader_error";
// Submissions, all or those to a phase, were paused or resumed by an organiser:
inline constexpr char kPauseEvent[] = "paused";
inline constexpr char kResumeEvent[] = "resumed";
// This host starts no blocks, as its self-test failed, or it does again:
inline constexpr char kHostPausedEvent[] = "host.paused";
inline constexpr char kHostResumedEvent[] = "host.resumed";
inline constexpr char kSelfTestFailedEvent[] = "self_test.failed";
// Only "myograde webhook test" sends it.
inline constexpr char kTestEvent[] = "test";

inline constexpr std::string_view kWebhookEvents[] = {  // all but the last
    kFinishedEvent, kFailedEvent,     kCancelledEvent,   kGraderErrorEvent,   kPauseEvent,
    kResumeEvent,   kHostPausedEvent, kHostResumedEvent, kSelfTestFailedEvent};

inline constexpr size_t kMostWebhooks = 16;

struct WebhookConfig {
  std::string name;         // letters, digits, ".", "_", "-"; unique
  std::string url;
  std::string secret_file;  // absolute
  std::set<std::string> events;
  std::string ca_file;      // absolute; "": the host's authorities
  absl::Duration timeout = absl::Seconds(10);        // of one attempt, as a whole
  absl::Duration give_up_after = absl::Hours(24);    // since the event
};

// The array at `webhooks`. Files and URLs are checked when the daemon starts (server/webhook).
absl::StatusOr<std::vector<WebhookConfig>> ReadWebhooks(const nlohmann::json& json,
                                                        const std::string& where);

}  // namespace myograde::server
