#include "server/admission/admission.h"

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/base/counted.h"
#include "server/base/error_code.h"
#include "server/engine/stored.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

// The share of a request's time that is spent waiting for the reference episodes.
constexpr double kReferenceShare = 0.8;

absl::Status BadRequest(const std::string& code, const std::string& message) {
  return WithErrorCode(absl::InvalidArgumentError(message), code);
}

// The seeds to play, in order: the whole ranked list, or for practice those of the request or of
// the track's list for it.
absl::StatusOr<std::vector<uint64_t>> SeedsOf(const SubmitRequest& request,
                                              const TrackConfig& config) {
  if (!request.seeds.has_value() && !request.episodes.has_value()) return config.seeds;
  std::vector<uint64_t> seeds = request.seeds.value_or(config.practice_seeds);
  const auto count = static_cast<int64_t>(seeds.size());
  if (request.episodes.value_or(1) > count) {
    return absl::InvalidArgumentError(
        absl::StrCat("request: \"episodes\" is ", *request.episodes, ", ",
                     request.seeds.has_value() ? "the seed list has "
                                               : "the track's list of practice seeds has ",
                     count));
  }
  seeds.resize(static_cast<size_t>(request.episodes.value_or(count)));
  return seeds;
}

// Who ranks a seed in an environment: a track, or a phase with public seeds. Hidden seeds are not
// looked at, so that no answer tells whether one was guessed. "": nobody.
std::string RankedBy(const TrackKind& kind, uint64_t seed, const Tracks& tracks,
                     const Phases& phases) {
  const std::string track = tracks.RankedBy(kind, seed);
  if (!track.empty()) return absl::StrCat("track \"", track, "\"");
  for (const PhasePtr& phase : phases.entries()) {
    const TrackConfig& config = phase->track->config;
    if (config.kind != &kind || !config.seed_salt.empty()) continue;
    if (std::find(config.seeds.begin(), config.seeds.end(), seed) != config.seeds.end()) {
      return absl::StrCat("phase \"", phase->config.name, "\"");
    }
  }
  return "";
}

// Practice that plays a ranked seed would be a ranked evaluation with more tries.
absl::Status CheckPractice(const std::vector<uint64_t>& seeds, const TrackConfig& config,
                           const Tracks& tracks, const Phases& phases) {
  for (const uint64_t seed : seeds) {
    const std::string who = RankedBy(*config.kind, seed, tracks, phases);
    if (who.empty()) continue;
    return BadRequest("ranked_seed",
                      absl::StrCat("practice can't use the seed ", seed, ", which ", who,
                                   " ranks; leave \"seeds\" and \"episodes\" out for a ranked "
                                   "evaluation, or choose other seeds"));
  }
  return absl::OkStatus();
}

}  // namespace

Admission::Admission(AdmissionOptions options, const Tracks& tracks, const Phases& phases,
                     Engine& engine, ReaderPool& readers, const Clock& clock)
    : options_(std::move(options)),
      tracks_(tracks),
      phases_(phases),
      engine_(engine),
      readers_(readers),
      clock_(clock),
      runtimes_(options_.config.runtimes, options_.config.runtimes_dir) {}

absl::StatusOr<ReceivedArtefact> Admission::Receive(const UploadRequest& request,
                                                    IncomingArchive& archive) {
  const std::string& team = request.from.team;
  const TrackKind* kind = nullptr;
  if (!team.empty()) {
    ASSIGN_OR_RETURN(const TrackPtr track, tracks_.Find(request.track, ""));
    RETURN_IF_ERROR(CheckTries(team, request.track));
    if (request.founding.has_value()) RETURN_IF_ERROR(Found(team, *request.founding));
    kind = track->config.kind;
  }
  absl::StatusOr<ReceivedArtefact> received = Take(request, archive, kind);
  if (!absl::IsInvalidArgument(received.status())) return received;
  RETURN_IF_ERROR(ChargeRefusal(request, received.status()));
  return WithErrorCode(received.status(), "bad_artefact");
}

absl::Status Admission::CheckTries(const std::string& team, const std::string& track) {
  return readers_.Read([&](const Transaction& reader) {
    RETURN_IF_ERROR(reader.teams.Check(team));
    const QuotaUse use = reader.quotas.CountQuotaUse(reader.teams.NameOf(team), track,
                                                     absl::ToUnixMillis(clock_.Now()));
    return CheckFailures(use, options_.config.quota.of(track).quota, team, track);
  });
}

absl::Status Admission::Found(const std::string& team, const Founding& founding) {
  return engine_.Change(
      [team, founding](Transaction& writer) {
        return writer.teams.Found(team, founding.person, founding.most);
      },
      options_.config.http.request);
}

absl::Status Admission::ChargeRefusal(const UploadRequest& request, const absl::Status& refusal) {
  if (request.from.team.empty()) return absl::OkStatus();
  return engine_.Change(
      [team = request.from.team, track = request.track, who = request.from.uploader,
       why = absl::StrCat("upload refused: ", refusal.message())](Transaction& writer) {
        return writer.quotas.ChargeFailure(team, track, who, why);
      },
      options_.config.http.request);
}

absl::StatusOr<Accepted> Admission::Submit(const SubmitRequest& request, const std::string& who) {
  ASSIGN_OR_RETURN(std::optional<Accepted> earlier, FindEarlier(readers_, who, request.key));
  if (earlier.has_value()) return *earlier;
  const absl::Time now = Now();
  ASSIGN_OR_RETURN(const Entry entry, EntryOf(request, now));
  const TrackConfig& config = entry.track->config;
  ASSIGN_OR_RETURN(const std::vector<uint64_t> seeds, SeedsOf(request, config));
  if (entry.phase != nullptr) RETURN_IF_ERROR(CheckInvited(request.team, entry.phase->config));
  if (request.seeds.has_value() || request.episodes.has_value()) {
    RETURN_IF_ERROR(CheckPractice(request.seeds.value_or(seeds), config, tracks_, phases_));
  }
  ASSIGN_OR_RETURN(const ArtefactRow artefact, CheckedArtefact(request, who, config));
  NewSubmission submission = Compose(request, entry, seeds, artefact);
  submission.extra_observations =
      ShowsExtraObservations(artefact.extra_observations, !artefact.adapter.empty(), config);
  submission.request_key = request.key;
  submission.founding = request.founding;
  if (submission.ranked) RETURN_IF_ERROR(CheckRankedHere(*config.kind));
  AdmissionRules rules = options_.config.quota.of(config.id);
  if (entry.phase != nullptr) {
    rules = PhaseRules(entry.phase->config, rules);
    submission.closed = CheckOpen(entry.phase->config, now);
  }
  return engine_.Submit(submission, rules, who, options_.config.http.request);
}

// The seeds of a phase are all played or none: what plays others is practice, on the track itself.
absl::StatusOr<Admission::Entry> Admission::EntryOf(const SubmitRequest& request,
                                                    absl::Time now) const {
  const bool practice = request.seeds.has_value() || request.episodes.has_value();
  if (practice && !request.phase.empty()) {
    return absl::InvalidArgumentError(
        "request: \"phase\" can't be combined with \"seeds\" or \"episodes\", because a phase is "
        "played as a whole; leave one of them out");
  }
  ASSIGN_OR_RETURN(const TrackPtr track, tracks_.Find(request.track, request.profile));
  if (!HasPhases(phases_, request.track)) {
    if (request.phase.empty()) return Entry{track, nullptr, true};
  } else if (practice) {
    return Entry{track, nullptr, false};
  }
  ASSIGN_OR_RETURN(const PhasePtr phase,
                   FindPhase(phases_, {request.phase, request.track, request.profile}, now));
  return Entry{phase->track, phase, true};
}

absl::Time Admission::Now() {
  const absl::Time now = clock_.Now();
  if (const auto jump = calendar_.Jump(now, clock_.Monotonic())) {
    spdlog::warn(
        "the system clock was set {} by {}; phases and quota days follow it",
        *jump > absl::ZeroDuration() ? "forward" : "back",
        absl::FormatDuration(absl::AbsDuration(*jump)));
  }
  return now;
}

absl::StatusOr<std::optional<Accepted>> FindEarlier(ReaderPool& readers, const std::string& who,
                                                    const RequestKey& key) {
  if (key.key.empty()) return std::optional<Accepted>();
  return readers.Read<std::optional<Accepted>>(
      [&](const Transaction& reader) { return reader.submissions.FindRequest(who, key); });
}

absl::Status Admission::CheckInvited(const std::string& team, const PhaseConfig& phase) {
  if (phase.teams.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const bool invited, readers_.Read<bool>([&](const Transaction& reader) {
    return std::any_of(phase.teams.begin(), phase.teams.end(), [&](const std::string& name) {
      return reader.teams.NameOf(name) == reader.teams.NameOf(team);
    });
  }));
  if (invited) return absl::OkStatus();
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat(
          "phase \"", phase.name, "\" is open to ", Counted(std::ssize(phase.teams), "team"),
          " named by the organisers, and \"", team, "\" is not one of them")),
      kForbiddenCode);
}

// Engine::Submit checks for the files again, at a point where nothing can remove them.
absl::StatusOr<ArtefactRow> Admission::CheckedArtefact(const SubmitRequest& request,
                                                       const std::string& who,
                                                       const TrackConfig& config) {
  const std::string& hash = request.artefact;
  ASSIGN_OR_RETURN(ArtefactRow artefact, readers_.Read<ArtefactRow>([&](const Transaction& reader) {
    // Nobody learns from the answer that there is another team's.
    const bool may =
        request.organiser || reader.content.UploadedArtefact(hash, who) ||
        (!request.team.empty() && reader.content.TeamHoldsArtefact(hash, request.team));
    return may ? reader.content.Artefact(hash) : UnknownArtefact(hash);
  }));
  RETURN_IF_ERROR(HasArtefactFiles(options_.data_dir, hash));
  if (artefact.bytes > config.budgets.submission_bytes ||
      artefact.files > config.budgets.submission_files) {
    return BadRequest("bad_artefact",
                      absl::StrCat("the artefact has ", artefact.bytes, " bytes in ",
                                   Counted(artefact.files, "file"), "; track \"", config.id,
                                   "\" allows ", config.budgets.submission_bytes, " bytes and ",
                                   config.budgets.submission_files, " files"));
  }
  for (const std::string& runtime : artefact.runtimes) {
    if (options_.config.runtimes.contains(runtime)) continue;
    if (!absl::IsNotFound(runtimes_.Find(runtime).status())) continue;
    return BadRequest("unknown_runtime",
                      absl::StrCat("this server has no runtime \"", runtime,
                                   "\", which the artefact's policy.json asks for"));
  }
  absl::Status status = CheckAdapter(artefact.adapter, *config.kind);
  if (status.ok()) status = CheckExtraObservations(artefact.extra_observations, config);
  if (!status.ok()) return WithErrorCode(status, "bad_artefact");
  return artefact;
}

NewSubmission Admission::Compose(const SubmitRequest& request, const Entry& entry,
                                 const std::vector<uint64_t>& seeds,
                                 const ArtefactRow& artefact) const {
  const TrackConfig& config = entry.track->config;
  NewSubmission submission;
  submission.team = request.team;
  submission.artefact = request.artefact;
  submission.track = config.id;
  submission.profile = config.profile;
  submission.config = config.hash;
  submission.config_json = CanonicalJson(config.effective);
  submission.seeds_json = CanonicalJson(nlohmann::json(seeds));
  submission.seeds = Sha256Hex(submission.seeds_json);
  submission.ranked = entry.ranks && seeds == config.seeds;
  submission.phase = config.phase;
  submission.grader_json =
      CanonicalJson(WithRuntimes(GraderBuild(options_.cache_dir, {artefact.adapter}),
                                 RuntimeDigests(runtimes_, artefact.runtimes)));
  submission.blocks = SplitIntoBlocks(std::ssize(seeds), config.episodes_per_lease);
  return submission;
}

absl::Status Admission::CheckRankedHere(const TrackKind& kind) const {
  if (options_.reference == nullptr) return absl::OkStatus();
  const std::optional<std::string> verdict =
      options_.reference(kind.name, options_.config.http.request * kReferenceShare);
  if (verdict.has_value() && verdict->empty()) return absl::OkStatus();
  return WithErrorCode(
      absl::UnavailableError(
          verdict.has_value()
              ? absl::StrCat(*verdict, "; only practice (fewer episodes) is graded here")
              : "the reference episodes, which decide whether this host may grade ranked "
                "submissions, are still being played; try again in a few seconds"),
      "not_official");
}

}  // namespace myograde::server
