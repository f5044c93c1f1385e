// What the runner and the simulator say to each other over a SOCK_SEQPACKET
// socket pair: one JSON object per packet, sometimes with a file descriptor.
// Both are the grader's own; the participant never sees this channel.
//
//   sim -> runner   {"type":"need_policy"}            start a fresh sandbox
//                   {"type":"policy_fault", ...}      FaultEvidence as the sim saw it
//                   {"type":"need_cpu"}               read the CPU time now
//                   {"type":"need_log","episode":N}   the log to play episode N from
//                   a LeaseRecord line                 progress, episode or replay
//                   {"type":"done"}                   every episode was recorded
//   runner -> sim   {"type":"policy"} + descriptor     the bridge's socket
//                   {"type":"cpu"}                     the page below has the new reading
//                   {"type":"log"} + descriptor        the log's file, opened for reading
//                   {"type":"no_policy", ...}         FaultEvidence: none is started any more
//                   {"type":"ruling", ...}            FaultEvidence after looking at the
//                                                      control group, limits and exit status
//
// The logs of episodes go through a pipe of their own, packed, one after the
// other: all bytes of a log are in the pipe before its episode's record is sent.
//
// The policy's CPU time so far, in ns, is kept by the runner in a page of
// shared memory (CpuPage) that the simulator reads without a system call. It is
// as old as cpu_refresh_s of sandbox/policy.json, so where that matters the
// simulator asks for a new one. In the same page the simulator says when it waits for an
// answer and for which, and the runner how long the policy was idle then.
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
inline constexpr int kSimOrderFd = 4;    // the lease order, JSON, read to its end
inline constexpr int kSimCpuPageFd = 5;  // one CpuPage
inline constexpr int kSimLogFd = 6;      // the logs' pipe, non-blocking; if there is a log_dir

// The bridge inherits its socket to the simulator as this descriptor.
inline constexpr int kBridgeSocketFd = 3;

// The simulator sends progress records this often, while it plays and while it waits: the runner
// is to hear from it every second.
inline constexpr absl::Duration kProgressPeriod = absl::Milliseconds(500);

struct CpuPage {
  std::atomic<uint64_t> cpu_ns;   // CPU time of everything in the policy's sandbox
  std::atomic<uint64_t> updates;  // counts refreshes; 0: never measured
  std::atomic<uint64_t> waits;    // the simulator's: odd while an answer is waited for
  std::atomic<uint64_t> idle_ns;  // wall time of such waits in which the policy wanted no processor
  std::atomic<uint64_t> starts;   // the simulator's: odd while it waits for a policy to start up
  // Wall time of that in which the policy wanted neither a processor nor a disk.
  std::atomic<uint64_t> start_idle_ns;
};

struct SimMessage {
  nlohmann::json json;
  Fd fd;  // invalid if none came
};

// Sends one packet. Fails with UnavailableError when the peer is gone.
absl::Status SendSimMessage(int socket, const nlohmann::json& json, int fd = -1);

// Waits for one packet until `timeout`: DeadlineExceededError then,
// UnavailableError when the peer is gone, InvalidArgumentError for nonsense.
absl::StatusOr<SimMessage> ReceiveSimMessage(int socket, absl::Duration timeout);

nlohmann::json FaultEvidenceToJson(const FaultEvidence& evidence);
absl::StatusOr<FaultEvidence> FaultEvidenceFromJson(const nlohmann::json& json);

}  // namespace myograde
