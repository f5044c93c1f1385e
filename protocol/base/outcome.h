// How an episode ended, whose fault it was, and the names for both: the same in records, JSON and
// leaderboards.
#pragma once

#include <optional>
#include <string_view>

namespace myograde {

// The outcome of one episode. The first cause wins. Values are stored by name, so the order here
// may change, the names may not.
enum class Outcome {
  kSuccess,        // played to its end, goal reached
  kFailure,        // played to its end, goal not reached (see FailureReason)
  kUnstable,       // MuJoCo warned about bad positions, velocities or accelerations
  kInitTimeout,    // the policy was not ready within its start-up budget
  kStepTimeout,    // a step used up its time and the bank of overtime
  kWallTimeout,    // the lease's wall-clock cap was reached
  kCpuLimit,       // the lease's CPU cap was reached
  kMemoryLimit,
  kProcessLimit,
  kDiskLimit,
  kProtocol,       // wrong size, wrong step, NaN, malformed or too many messages
  kCrash,          // exit or signal inside the participant's sandbox
  kCancelled,      // by the team or an organiser
  kGraderError,    // sim, runner, daemon or host failed: the lease is retried
};

// A name from a fixed list: of every track, or of one (protocol/tracks/<track>/facts.h). `name`
// must be a literal, as only the view is kept.
template <typename Tag>
class Word {
 public:
  constexpr Word() = default;
  explicit constexpr Word(std::string_view name) : name_(name) {}

  constexpr std::string_view name() const { return name_; }
  friend constexpr bool operator==(const Word&, const Word&) = default;

 private:
  std::string_view name_;
};

// Why a played episode is a failure. Every other outcome has kNone ("").
struct FailureReason : Word<FailureReason> {
  using Word::Word;
  static const FailureReason kNone;
  static const FailureReason kTime;     // the episode's simulated time ran out
  static const FailureReason kGivenUp;  // the policy gave up
};
inline constexpr FailureReason FailureReason::kNone;
inline constexpr FailureReason FailureReason::kTime("time");
inline constexpr FailureReason FailureReason::kGivenUp("given-up");

// How the episode ended in the simulator.
struct EpisodeEnd : Word<EpisodeEnd> {
  using Word::Word;
  static const EpisodeEnd kTime;     // the episode's simulated time ran out
  static const EpisodeEnd kGivenUp;  // the policy asked to end it
  static const EpisodeEnd kFault;    // not played to its end: see EpisodeFacts::fault
};
inline constexpr EpisodeEnd EpisodeEnd::kTime("time");
inline constexpr EpisodeEnd EpisodeEnd::kGivenUp("given-up");
inline constexpr EpisodeEnd EpisodeEnd::kFault("fault");

enum class Fault { kNobody, kParticipant, kGrader };

// The name used in JSON, the store and on boards ("success", "init_timeout").
std::string_view OutcomeName(Outcome outcome);
std::optional<Outcome> ParseOutcome(std::string_view name);

// Whose fault an outcome is. kUnstable is the participant's.
Fault FaultOf(Outcome outcome);

// "nobody", "participant", "grader".
std::string_view FaultName(Fault fault);

}  // namespace myograde
