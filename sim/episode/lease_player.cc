#include "sim/episode/lease_player.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/policy/channels.h"

namespace myograde::sim {
namespace {

// For building a sandbox or taking one down; the runner has deadlines of its
// own for both, far below these.
constexpr absl::Duration kSandboxDeadline = absl::Minutes(5);
constexpr absl::Duration kRulingDeadline = absl::Minutes(2);
constexpr absl::Duration kReadingDeadline = absl::Minutes(1);

absl::StatusOr<nlohmann::json> ParseParameters(const ParametersText& parameters) {
  if (parameters.size == 0) return nlohmann::json::object();
  ASSIGN_OR_RETURN(nlohmann::json json,
                   ParseJson({parameters.text, parameters.size}, "the policy's parameters"));
  if (json.is_object()) return json;
  return absl::InvalidArgumentError("the policy's parameters are no JSON object");
}

FaultEvidence ProtocolFault(std::string detail, int64_t step) {
  FaultEvidence evidence;
  evidence.outcome = Outcome::kProtocol;
  evidence.step = step;
  evidence.detail = std::move(detail);
  return evidence;
}

// True if a number had to be replaced by 0 because it was not finite.
bool MakeFinite(EpisodeFacts& facts) {
  bool changed = false;
  const auto fix = [&changed](double& value) {
    if (std::isfinite(value)) return;
    value = 0;
    changed = true;
  };
  fix(facts.sim_time);
  const auto look = [&fix](const char*, auto& value) {
    if constexpr (std::is_same_v<decltype(value), double&>) fix(value);
  };
  std::visit([&look](auto& measured) { measured.Visit(measured, look); }, facts.track);
  return changed;
}

// Facts of an episode that was never begun.
EpisodeFacts NothingPlayed(const TrackKind& kind) {
  EpisodeFacts facts;
  facts.track = kind.no_facts;
  return facts;
}

}  // namespace

LeasePlayer::LeasePlayer(const LeaseOrder& order, Environment& environment, int64_t max_steps,
                         int runner, CpuPage* cpu, const Clock& clock, LogWriter* log)
    : order_(order),
      environment_(environment),
      max_steps_(max_steps),
      runner_(runner),
      cpu_(cpu),
      clock_(clock),
      log_(log),
      extra_size_(order.extra_observations ? ExtraOf(*order.track.kind).size() : 0),
      restarts_left_(order.track.budgets.restarts),
      use_{absl::ZeroDuration(), clock.Monotonic()},
      last_progress_(clock.Monotonic()) {}

absl::Status LeasePlayer::Play() {
  for (const EpisodeOrder& episode : order_.episodes) {
    RETURN_IF_ERROR(PlayEpisode(episode));
  }
  EndSession();
  return SendSimMessage(runner_, {{"type", "done"}});
}

absl::Status LeasePlayer::PlayEpisode(const EpisodeOrder& episode) {
  index_ = episode.index;
  step_ = 0;
  reset_ = false;
  given_up_ = false;
  episode_wall_start_ = clock_.Monotonic();
  episode_cpu_start_ = session_.has_value() ? session_->cpu_used() : absl::ZeroDuration();
  startup_wall_ = startup_cpu_ = absl::ZeroDuration();
  BeginLog(episode);
  if (last_fault_.has_value()) return Record(episode, last_fault_);

  Result result = Run(episode);
  if (!result.ok()) return result.status();
  if (!result->has_value() || (*result)->outcome == Outcome::kUnstable) {
    // Bad numbers are the policy's doing, but its process did nothing wrong.
    return Record(episode, *result);
  }
  if (refused_) {
    last_fault_ = **result;
    last_fault_->step = -1;
    return Record(episode, last_fault_);
  }
  ASSIGN_OR_RETURN(FaultEvidence ruling, Rule(**result));
  absl::Status status = Record(episode, ruling);
  EndSession();
  const bool lease_spent =
      ruling.outcome == Outcome::kCpuLimit || ruling.outcome == Outcome::kWallTimeout;
  if (restarts_left_-- == 0 || lease_spent) {
    last_fault_ = std::move(ruling);
    last_fault_->step = -1;
  }
  return status;
}

LeasePlayer::Result LeasePlayer::Run(const EpisodeOrder& episode) {
  // Before the policy is there: an environment that carries state over is
  // reset once for each episode, whatever the policy does.
  environment_.Reset(episode.seed);
  reset_ = true;
  if (!session_.has_value()) {
    const absl::Duration before = clock_.Monotonic();
    Result result = StartPolicy(episode.policy_seed);
    startup_wall_ = clock_.Monotonic() - before;
    if (session_.has_value()) startup_cpu_ = session_->cpu_used();
    if (!result.ok() || result->has_value()) return result;
  } else if (auto fault = StartEpisode(episode.policy_seed); fault.has_value()) {
    return fault;
  }
  Result result = RunSteps();
  if (!result.ok()) return result;
  if (result->has_value() && (*result)->outcome != Outcome::kUnstable) return result;
  // The episode was played to its end. If the sandbox is gone by now, the next
  // episode will find out.
  [[maybe_unused]] const auto unheard =
      session_->Tell(messages_.EpisodeEnd(wire_episode_, step_));
  ++wire_episode_;
  return result;
}

LeasePlayer::Result LeasePlayer::StartPolicy(uint64_t policy_seed) {
  if (Result result = EnsurePolicy(); !result.ok() || result->has_value()) return result;
  if (Result result = Greet(); !result.ok() || result->has_value()) return result;
  std::optional<FaultEvidence> fault = StartEpisode(policy_seed);
  if (!fault.has_value()) Measure();  // what it used until now is no step's
  return fault;
}

LeasePlayer::Result LeasePlayer::EnsurePolicy() {
  ASSIGN_OR_RETURN(SimMessage message, AskRunner({{"type", "need_policy"}}, kSandboxDeadline));
  const std::string type = message.json["type"].get<std::string>();
  if (type == "no_policy") {
    ASSIGN_OR_RETURN(FaultEvidence evidence, FaultEvidenceFromJson(message.json));
    if (FaultOf(evidence.outcome) != Fault::kParticipant) {
      return absl::InternalError(absl::StrCat("episode ", index_, ": ", evidence.detail));
    }
    refused_ = true;
    return std::optional(std::move(evidence));
  }
  if (type != "policy" || !message.fd.valid()) {
    return absl::InternalError(absl::StrCat("the runner answered need_policy with \"", type,
                                            "\" without a sandbox"));
  }
  use_.cpu = lease_cpu_;
  session_.emplace(std::move(message.fd), order_.track.budgets, cpu_, clock_, use_,
                   [this] { Progress(); }, [this] { Measure(); });
  wire_episode_ = 0;
  episode_cpu_start_ = absl::ZeroDuration();
  return std::optional<FaultEvidence>();
}

LeasePlayer::Result LeasePlayer::Greet() {
  OrFault<HelloFrame> answer = session_->AwaitHello();
  if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::optional(std::move(*fault));
  const auto& hello = std::get<HelloFrame>(answer);
  hello_parameters_ = nlohmann::json::object();
  WelcomeInfo info;
  info.convention = hello.convention;
  info.max_steps = max_steps_;
  info.extra_observations = order_.extra_observations;
  if (hello.protocol_version != static_cast<uint32_t>(kProtocolVersion)) {
    info.reason = absl::StrCat("the policy speaks protocol version ",
                               static_cast<int32_t>(hello.protocol_version),
                               ", this grader speaks version ", kProtocolVersion);
  } else if (absl::Status status = TakeParameters(hello.parameters, hello_parameters_); !status.ok()) {
    info.reason = std::string(status.message());
  }
  info.accepted = info.reason.empty();
  std::optional<FaultEvidence> fault = session_->Tell(messages_.Welcome(order_.track, info));
  if (fault.has_value()) return fault;
  if (!info.accepted) return std::optional(ProtocolFault("refused: " + info.reason, -1));
  environment_.SetConvention(hello.convention);
  convention_ = hello.convention;
  return std::optional<FaultEvidence>();
}

std::optional<FaultEvidence> LeasePlayer::StartEpisode(uint64_t policy_seed) {
  OrFault<ReadyFrame> answer =
      session_->Start(messages_.EpisodeStart(wire_episode_, policy_seed));
  if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::move(*fault);
  nlohmann::json parameters = hello_parameters_;
  if (absl::Status status = TakeParameters(std::get<ReadyFrame>(answer).parameters, parameters);
      !status.ok()) {
    return ProtocolFault(absl::StrCat("refused: ", status.message()), -1);
  }
  if (log_ != nullptr) log_->Start({convention_, std::move(parameters)});
  return std::nullopt;
}

absl::Status LeasePlayer::TakeParameters(const ParametersText& uploaded, nlohmann::json& all) {
  ASSIGN_OR_RETURN(const nlohmann::json own, ParseParameters(uploaded));
  all.update(own);
  return all.empty() ? absl::OkStatus() : environment_.SetParameters(all);
}

LeasePlayer::Result LeasePlayer::RunSteps() {
  const auto action_size = static_cast<uint32_t>(environment_.action_size());
  while (true) {
    const std::span<double> values =
        messages_.ObservationValues(environment_.observation_size() + extra_size_);
    const std::span<double> observation = values.first(values.size() - extra_size_);
    environment_.Observe(observation);
    if (extra_size_ > 0) environment_.ObserveExtra(values.last(extra_size_));
    if (log_ != nullptr) observation_digest_.Update(std::as_bytes(observation));
    PolicySession::StepAnswer answer =
        session_->Ask(messages_.Observation(wire_episode_, step_, action_size));
    if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::optional(std::move(*fault));
    given_up_ = std::holds_alternative<GiveUpFrame>(answer);
    if (given_up_) return std::optional<FaultEvidence>();
    const auto& action = std::get<ActionFrame>(answer);
    const StepResult result = environment_.Step({action.values, action.size});
    const std::span<const double> entries = {action.values, action.size};
    digests_.Step(entries, environment_.state());
    if (log_ != nullptr) {
      log_->Step(entries, Shorten(observation_digest_.Finish()), Shorten(digests_.PeekStates()));
    }
    ++step_;
    if (result.overflow) {
      return absl::InternalError(
          absl::StrCat("a contact or constraint buffer was too small in step ", step_ - 1,
                       " of episode ", index_));
    }
    if (result.unstable) {
      FaultEvidence evidence;
      evidence.outcome = Outcome::kUnstable;
      evidence.step = step_ - 1;
      evidence.detail = absl::StrCat("the physics became unstable in step ", step_ - 1,
                                     "; gentler actions avoid that");
      return std::optional(std::move(evidence));
    }
    if (result.ended) return std::optional<FaultEvidence>();
    if ((step_ & 15) == 0) Progress();
    if (!progress_status_.ok()) return progress_status_;
  }
}

absl::StatusOr<FaultEvidence> LeasePlayer::Rule(const FaultEvidence& seen) {
  nlohmann::json message = FaultEvidenceToJson(seen);
  message["type"] = "policy_fault";
  ASSIGN_OR_RETURN(SimMessage answer, AskRunner(message, kRulingDeadline));
  if (answer.json["type"] != "ruling") {
    return absl::InternalError("the runner answered policy_fault with another message");
  }
  absl::StatusOr<FaultEvidence> ruling = FaultEvidenceFromJson(answer.json);
  if (ruling.ok() && FaultOf(ruling->outcome) != Fault::kParticipant) {
    return absl::InternalError(absl::StrCat("episode ", index_, ": ", ruling->detail));
  }
  return ruling;
}

void LeasePlayer::EndSession() {
  if (!session_.has_value()) return;
  lease_cpu_ += session_->cpu_used();
  session_.reset();
}

void LeasePlayer::BeginLog(const EpisodeOrder& episode) {
  if (log_ == nullptr) return;
  LogHeader header;
  // One of the order's own seeds, so it is valid.
  if (auto track = WithSeeds(order_.track, {episode.seed}); track.ok()) header.track = *track;
  header.config = order_.track.hash;
  header.episode = episode.index;
  header.first = episode.index == order_.episodes.front().index;
  header.seed = episode.seed;
  header.begun = !last_fault_.has_value();
  log_->Begin(header);
}

absl::Status LeasePlayer::EndLog(EpisodeFacts& facts) {
  if (log_ == nullptr) return absl::OkStatus();
  LogEnd end;
  end.steps = facts.steps;
  end.end = std::string(facts.end == EpisodeEnd::kFault ? OutcomeName(facts.fault.outcome)
                                                        : facts.end.name());
  end.digest = facts.digest;
  ASSIGN_OR_RETURN(facts.log, log_->End(std::move(end)));
  return absl::OkStatus();
}

absl::Status LeasePlayer::Record(const EpisodeOrder& episode,
                                 const std::optional<FaultEvidence>& fault) {
  EpisodeFacts facts = reset_ ? environment_.facts() : NothingPlayed(*order_.track.kind);
  facts.index = episode.index;
  facts.seed = episode.seed;
  facts.digest = digests_.FinishStates();
  facts.actions_digest = digests_.FinishActions();
  observation_digest_.Finish();  // of a question that was not answered
  if (given_up_) facts.end = EpisodeEnd::kGivenUp;
  if (fault.has_value()) {
    facts.end = EpisodeEnd::kFault;
    facts.fault = *fault;
  }
  RETURN_IF_ERROR(EndLog(facts));
  // Only a state that MuJoCo called unstable may hold numbers that are none.
  const bool finite = !MakeFinite(facts);
  if (!finite && !(fault.has_value() && fault->outcome == Outcome::kUnstable)) {
    return absl::InternalError(
        absl::StrCat("episode ", index_, " was measured with a number that is not finite"));
  }
  TellTimes(facts);
  if (reset_ && finite) facts.details = environment_.details();
  return SendSimMessage(runner_, EpisodeRecordToJson(facts));
}

void LeasePlayer::TellTimes(EpisodeFacts& facts) {
  const auto seconds = [](absl::Duration time) {
    return absl::ToDoubleSeconds(std::max(time, absl::ZeroDuration()));
  };
  facts.wall_s = seconds(clock_.Monotonic() - episode_wall_start_ - startup_wall_);
  if (session_.has_value()) {
    facts.policy_cpu_s = seconds(session_->cpu_used() - episode_cpu_start_ - startup_cpu_);
  }
}

absl::StatusOr<SimMessage> LeasePlayer::AskRunner(const nlohmann::json& question,
                                                  absl::Duration limit) {
  RETURN_IF_ERROR(SendSimMessage(runner_, question));
  const absl::Duration deadline = clock_.Monotonic() + limit;
  while (true) {
    absl::StatusOr<SimMessage> message = ReceiveSimMessage(runner_, kProgressPeriod);
    if (!absl::IsDeadlineExceeded(message.status())) return message;
    if (clock_.Monotonic() > deadline) {
      return absl::DeadlineExceededError(
          absl::StrCat("the runner was silent for ", absl::FormatDuration(limit)));
    }
    Progress();
    if (!progress_status_.ok()) return progress_status_;
  }
}

void LeasePlayer::Measure() {
  if (!progress_status_.ok()) return;
  const absl::StatusOr<SimMessage> answer = AskRunner({{"type", "need_cpu"}}, kReadingDeadline);
  if (!answer.ok()) {
    progress_status_ = answer.status();
  } else if (answer->json["type"] != "cpu") {
    progress_status_ = absl::InternalError("the runner answered need_cpu with another message");
  }
}

void LeasePlayer::Progress() {
  const absl::Duration now = clock_.Monotonic();
  if (now - last_progress_ < kProgressPeriod || !progress_status_.ok()) return;
  last_progress_ = now;
  progress_status_ = SendSimMessage(
      runner_, {{"type", "progress"}, {"episode", index_}, {"step", step_}});
}

}  // namespace myograde::sim
