// The names of the LCM channels and of a policy's environment variables, shared by the bridge, the
// simulator and the C++ kit.
#pragma once

#include <cstdint>
#include <string_view>

namespace myograde {

inline constexpr int32_t kProtocolVersion = 1;

// Policy to grader.
inline constexpr std::string_view kHelloChannel = "MYOGRADE_HELLO";
inline constexpr std::string_view kReadyChannel = "MYOGRADE_EPISODE_READY";
inline constexpr std::string_view kActionChannel = "MYOGRADE_ACTION";
inline constexpr std::string_view kGiveUpChannel = "MYOGRADE_GIVE_UP";
// Grader to policy.
inline constexpr std::string_view kWelcomeChannel = "MYOGRADE_WELCOME";
inline constexpr std::string_view kStartChannel = "MYOGRADE_EPISODE_START";
inline constexpr std::string_view kObservationChannel = "MYOGRADE_OBSERVATION";
inline constexpr std::string_view kEndChannel = "MYOGRADE_EPISODE_END";
// Only in episode logs (protocol/log/episode_log.h).
inline constexpr std::string_view kLogHeaderChannel = "MYOGRADE_LOG_HEADER";
inline constexpr std::string_view kLogStartChannel = "MYOGRADE_LOG_START";
inline constexpr std::string_view kLogDigestChannel = "MYOGRADE_LOG_DIGEST";
inline constexpr std::string_view kLogEndChannel = "MYOGRADE_LOG_END";

// The bus inside a sandbox: LCM's usual multicast group and port. A time to
// live of 0 keeps packets on the host.
inline constexpr char kBusUrl[] = "udpm://239.255.76.67:7667?ttl=0";
inline constexpr char kBusUrlVariable[] = "MYOGRADE_LCM_URL";

}  // namespace myograde
