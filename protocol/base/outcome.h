// How an episode ended, whose fault it was, and the words for it. One list for
// records, JSON and leaderboards.
#pragma once

#include <optional>
#include <string_view>

namespace myograde {

// The outcome of one episode. The first cause wins. Values are stored by name,
// so the order here may change, the names may not.
enum class Outcome {
  kSuccess,        // played to its end, goal reached
  kFailure,        // played to its end, goal not reached (see FailureReason)
  kUnstable,       // MuJoCo warned of bad positions, velocities, accelerations
  kInitTimeout,    // the policy was not ready in its start-up budget
  kStepTimeout,    // a step's time and the bank of overtime were used up
  kWallTimeout,    // the lease's wall-clock cap was reached
  kCpuLimit,       // the lease's CPU cap was reached
  kMemoryLimit,
  kProcessLimit,
  kDiskLimit,
  kOutputLimit,
  kProtocol,       // wrong size, wrong step, NaN, malformed or too many messages
  kCrash,          // exit or signal inside the participant's sandbox
  kCancelled,      // by the team or an organiser
  kGraderError,    // sim, runner, daemon or host failed: played again
};

// Why a played episode is a failure. kNone belongs to every other outcome.
enum class FailureReason {
  kNone,
  kDropped,   // manipulation: object below the drop height
  kTime,      // the episode's simulated time was over
  kForce,     // manipulation: contact force above the limit ('throwing')
  kHandover,  // manipulation: a limb touched for too short, or goal not held
  kContact,   // manipulation: the object touched something it must not
  kPhantom,   // manipulation, as-graded only: ended at once by the episode before
  kFell,      // locomotion
  kOffTrack,  // locomotion
  kGivenUp,   // the policy ended the episode by its own will
};

enum class Fault { kNobody, kParticipant, kGrader };

// The word used in JSON, the store and on boards ("success", "init_timeout").
std::string_view OutcomeName(Outcome outcome);
std::optional<Outcome> ParseOutcome(std::string_view name);

// The word for a reason; "" for kNone.
std::string_view FailureReasonName(FailureReason reason);
std::optional<FailureReason> ParseFailureReason(std::string_view name);

// Whose fault an outcome is. kUnstable is the participant's.
Fault FaultOf(Outcome outcome);

// "nobody", "participant", "grader".
std::string_view FaultName(Fault fault);

}  // namespace myograde
