// The messages between runner and simulator over a SOCK_SEQPACKET socket pair: one JSON object per
// packet, sometimes with a file descriptor. Both ends are the grader's own; the participant never
// sees this channel.
//
//   sim -> runner   {"type":"need_policy"}            start a fresh sandbox
//                   {"type":"policy_fault", ...}      FaultEvidence as the sim saw it
//                   {"type":"need_cpu"}               read the CPU time now
//                   {"type":"need_log","episode":N}   the log to replay episode N from
//                   a LeaseRecord line                 progress, episode or replay
//                   {"type":"trajectory","bytes":N}   the last episode's is in its memory file
//                   {"type":"done"}                   every episode was recorded
//   runner -> sim   {"type":"policy"} + descriptor     the bridge's socket
//                   {"type":"cpu"}                     the page below has the new reading
//                   {"type":"log"} + descriptor        the log's file, opened for reading
//                   {"type":"no_policy", ...}         FaultEvidence: none will be started
//                   {"type":"ruling", ...}            FaultEvidence after checking the
//                                                      control group, limits and exit status
//
// Episode logs go through a separate pipe, packed, one after the other: all bytes of a log are in
// the pipe before its episode's record is sent.
//
// The runner keeps the policy's CPU time so far, in ns, in a page of shared memory (CpuPage) that
// the simulator reads without a system call. It may be as old as cpu_refresh_s of
// sandbox/policy.json, so where that matters the simulator requests a new reading. In the same page
// the simulator publishes when it waits for which answer, and the runner how long the policy was
// idle meanwhile.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "protocol/tracks/episode_facts.h"
#include "protocol/base/fd.h"

namespace myograde {

// Descriptors that the simulator inherits.
inline constexpr int kSimChannelFd = 3;
inline constexpr int kSimOrderFd = 4;    // the lease order, JSON, until end of file
inline constexpr int kSimCpuPageFd = 5;  // one CpuPage
inline constexpr int kSimLogFd = 6;      // the logs' pipe, non-blocking; if there is a log_dir
// A memory file of kMostTrajectoryFileBytes that can't grow, to be mapped for a trajectory; if the order
// asks for one.
inline constexpr int kSimTrajectoryFd = 7;
inline constexpr int64_t kMostTrajectoryFileBytes = int64_t{64} << 20;

// The descriptor of the simulator's socket that the bridge inherits.
inline constexpr int kBridgeSocketFd = 3;

// How often the simulator sends progress records, both while playing and while waiting: the runner
// expects one every second.
inline constexpr absl::Duration kProgressPeriod = absl::Milliseconds(500);

struct CpuPage {
  std::atomic<uint64_t> cpu_ns;   // CPU time of everything in the policy's sandbox
  std::atomic<uint64_t> updates;  // number of refreshes; 0: never measured
  std::atomic<uint64_t> waits;    // written by the simulator: odd while waiting for an answer
  std::atomic<uint64_t> idle_ns;  // wall time of such waits in which the policy wanted no processor
  std::atomic<uint64_t> starts;   // written by the simulator: odd while waiting for a policy to
                                  // start up
  // Wall time of those waits in which the policy wanted neither a processor nor a disk.
  std::atomic<uint64_t> start_idle_ns;
};

struct SimMessage {
  nlohmann::json json;
  Fd fd;  // invalid if none came
};

// Sends one packet. UnavailableError if the peer is gone.
absl::Status SendSimMessage(int socket, const nlohmann::json& json, int fd = -1);

// Receives one packet. DeadlineExceededError after `timeout`, UnavailableError if the peer is gone,
// InvalidArgumentError for a malformed packet.
absl::StatusOr<SimMessage> ReceiveSimMessage(int socket, absl::Duration timeout);

nlohmann::json FaultEvidenceToJson(const FaultEvidence& evidence);
absl::StatusOr<FaultEvidence> FaultEvidenceFromJson(const nlohmann::json& json);

}  // namespace myograde
