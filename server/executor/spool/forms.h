// What the daemon and the nodes of a cluster write for each other, one JSON text a file
// (README.md). Whoever reads one checks every key: nodes are trusted with records, not with the
// daemon's memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// Largest texts, in bytes.
inline constexpr size_t kMostOrderBytes = 4u << 20;
inline constexpr size_t kMostFormBytes = 256u << 10;
inline constexpr size_t kMostWhyBytes = 16u << 10;  // of what a node says
inline constexpr int64_t kMostRecordBytes = int64_t{64} << 20;

// The packed submission of an order (artefact_tar.h).
struct NodeArtefact {
  std::string digest;          // of its files, as the daemon stores them
  std::string archive_sha256;  // of the archive
  int64_t archive_bytes = 0;
};

// A runtime of the order, which must be on the node at this very path.
struct NodeRuntime {
  std::string name;
  std::string digest;
  std::string path;
};

// What a node needs to play one attempt of a lease.
struct NodeOrder {
  std::string name;   // of the lease folder
  std::string epoch;  // of the daemon that wrote it
  // Without what only the node knows: its folders, user and slot.
  LeaseOrder order;
  std::optional<NodeArtefact> artefact;  // nullopt: the order replays logs, or runs nothing packed
  std::vector<NodeRuntime> runtimes;
  std::string grader;  // the daemon's GraderBuild with the order's adapter, as canonical JSON
  double wall_s = 0;   // longest run
  // First of the sandboxes' users where root runs the node (server/sandbox/users.h); -1: none.
  int64_t uid_base = -1;
  bool self_test = false;
  bool logs = true;    // the episodes' logs are wanted
  // Nodes that must prove themselves anew, whatever they remember of an earlier proof.
  std::vector<std::string> prove_again;
};

// Who plays the attempt. The first claim of a folder is the only one.
struct NodeClaim {
  std::string node;
  std::string job;      // the cluster's name for it; "": none
  int64_t restart = 0;  // how often the cluster started the job again
  std::string nonce;    // 16 hexadecimal digits, of this process alone
};

// What a node says of itself before it plays.
struct NodeProof {
  std::string node;
  std::string processor;  // as the kernel names it
  std::string kernel;     // release
  std::string version;    // of its programs
  std::string grader;     // its own GraderBuild, as canonical JSON
  // Why its physics are not those of the reference episodes; "" if they are.
  std::string reference;
  std::vector<std::string> doctor;  // what is missing on it, a sentence each
};

// How an attempt ended on its node.
struct NodeEnd {
  int wait_status = 0;          // of the runner, as of waitpid(2); 0 if there was none
  std::string stderr_tail;      // of the runner
  int64_t records_bytes = 0;    // of all records
  std::string records_sha256;   // of as many; with a `why`, the file may be longer
  double cpu_s = 0;             // of all processes of the lease
  std::optional<double> energy_j;
  // Why the node did not play it, or not to its end, though that is nobody's fault; "": the runner
  // has ended by itself.
  std::string why;
};

// Exit statuses of myograde-node: all that the daemon learns where no word of the node's arrives.
inline constexpr int kNodeDone = 0;         // the end has arrived, whatever it says
inline constexpr int kNodeTrouble = 4;      // it has not; stderr says why
inline constexpr int kNodeUnreachable = 69; // no connection to the daemon, or the spool can't be read
inline constexpr int kNodeSecond = 75;      // another process plays the attempt
inline constexpr int kNodeUntrusted = 76;   // the daemon's certificate is none that the node trusts
inline constexpr int kNodeClock = 77;       // the certificate is not valid by the node's clock
inline constexpr int kNodeCaFile = 78;      // the file of authorities can't be read

// A text of one line, without a line feed.
std::string NodeOrderToText(const NodeOrder& order);
std::string NodeClaimToText(const NodeClaim& claim);
std::string NodeProofToText(const NodeProof& proof);
std::string NodeEndToText(const NodeEnd& end);

// The reverse. `where` names the text in errors. InvalidArgumentError: which key is wrong and how,
// or that the text is none of a known form.
absl::StatusOr<NodeOrder> NodeOrderFromText(std::string_view text, const std::string& where);
absl::StatusOr<NodeClaim> NodeClaimFromText(std::string_view text, const std::string& where);
absl::StatusOr<NodeProof> NodeProofFromText(std::string_view text, const std::string& where);
absl::StatusOr<NodeEnd> NodeEndFromText(std::string_view text, const std::string& where);

// LEASE-ATTEMPT-NONCE: two numbers, and 16 hexadecimal digits that nobody can guess.
bool IsLeaseName(std::string_view name);
// 1 to 255 letters, digits, dots, hyphens and underscores; neither "." nor "..".
bool IsNodeName(std::string_view name);
// 64 lower-case hexadecimal digits.
bool IsDigest(std::string_view text);
// The name of an episode's log (LogFileName in server/runner/log_keeper.h).
bool IsLogName(std::string_view name);

}  // namespace myograde::server
