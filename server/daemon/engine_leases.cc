// Starting leases, hearing their runners, and what follows from how they end.
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <filesystem>
#include <thread>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/config_reader.h"
#include "server/daemon/engine.h"
#include "server/daemon/results.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// A lease's folder goes away with the lease; what can't be removed is told and left.
void RemoveFolder(const std::string& path) {
  std::error_code error;
  fs::remove_all(path, error);
  if (error) spdlog::warn("{}: can't be removed: {}", path, error.message());
}

// Reasons are one sentence; the whole output is in the log.
std::string LastLineOf(const std::string& text) {
  const size_t end = text.find_last_not_of(" \n");
  if (end == std::string::npos) return "nothing";
  const size_t begin = text.rfind('\n', end);
  const size_t first = begin == std::string::npos ? 0 : begin + 1;
  return text.substr(first, end - first + 1);
}

nlohmann::json OutputJson(const LeaseEndRecord& end) {
  return {{"stdout_tail", end.stdout_tail},
          {"stderr_tail", end.stderr_tail},
          {"stdout_truncated", end.stdout_truncated},
          {"stderr_truncated", end.stderr_truncated},
          {"policy_cpu_s", end.policy_cpu_s},
          {"wall_s", end.wall_s},
          {"peak_memory_bytes", end.peak_memory_bytes}};
}

}  // namespace

uint64_t PolicySeed(const std::string& secret, const std::string& artefact, int64_t episode) {
  const std::string message = absl::StrCat(artefact, "/", episode);
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(message.data()), message.size(), digest, &size);
  uint64_t seed = 0;
  for (unsigned i = size - 8; i < size; ++i) seed = seed << 8 | digest[i];
  return seed & (~uint64_t{0} >> 1);
}

LeaseOrder Engine::OrderFor(const LeaseRun& run, const Start& start) const {
  LeaseOrder order;
  order.lease = absl::StrCat(run.lease, "-", run.attempt);
  order.artefact_dir = absl::StrCat(options_.data_dir, "/artefacts/", run.context->artefact);
  order.command = run.context->command;
  order.runtimes = run.context->runtimes;
  order.track = run.context->track->config;
  for (int64_t index = run.first; index <= run.last; ++index) {
    order.episodes.push_back(
        {index, (*run.context->seeds)[static_cast<size_t>(index)],
         PolicySeed(store_.policy_secret(), run.context->artefact, index)});
  }
  order.uid = options_.slot_uids ? options_.config.uid_base + start.slot : -1;
  order.slot = start.slot;
  order.work_dir = run.work_dir;
  order.cache_dir = options_.cache_dir;
  return order;
}

absl::Status Engine::Launch(LeaseRun& run, const Start& start) {
  run.work_dir = absl::StrCat(options_.data_dir, "/work/", run.lease, "-", run.attempt);
  std::error_code error;
  fs::remove_all(run.work_dir, error);
  if (!fs::create_directory(run.work_dir, error)) {
    return absl::UnavailableError(absl::StrCat(run.work_dir, ": can't be made: ", error.message()));
  }
  fs::permissions(run.work_dir, fs::perms::owner_all, error);
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner =
      RunnerProcess::Start(OrderFor(run, start));
  if (!runner.ok()) return runner.status();
  run.runner = *std::move(runner);
  return absl::OkStatus();
}

void Engine::StartLeases() {
  for (;;) {
    std::optional<Start> start;
    {
      const std::lock_guard lock(mutex_);
      start = scheduler_.Next(clock_.Monotonic());
    }
    if (!start.has_value()) return;
    StartLease(*start);
  }
}

void Engine::StartLease(const Start& start) {
  LeaseRun run;
  run.context = contexts_.at(start.evaluation);
  run.lease = start.lease;
  run.attempt = start.attempt;
  std::tie(run.first, run.last) = run.context->leases.at(start.lease);
  const int64_t deadline = absl::ToUnixMillis(clock_.Now() + start.lease_wall);
  Later([start, deadline, who = owner_](Writer& writer) {
    return writer.StartLease(start.lease, start.attempt, start.slot, deadline, who);
  });
  if (absl::Status status = Launch(run, start); !status.ok()) {
    RemoveFolder(run.work_dir);
    Fault(run, absl::StrCat("the runner did not start: ", status.message()));
    return;
  }
  spdlog::info("lease {} (evaluation {}, episodes {} to {}): attempt {} on slot {}, process {}",
               run.lease, start.evaluation, run.first, run.last, run.attempt, start.slot,
               run.runner->pid());
  const std::lock_guard lock(mutex_);
  live_[run.lease] = {run.first, 0, clock_.Monotonic()};
  running_[run.lease] = std::move(run);
}

void Engine::Listen(LeaseRun& run) {
  absl::StatusOr<std::vector<LeaseRecord>> records = run.runner->Read();
  if (!records.ok()) {
    if (run.fault.empty()) run.fault = std::string(records.status().message());
    run.runner->Kill();
    return;
  }
  for (const LeaseRecord& record : *records) {
    if (!run.fault.empty()) return;  // nothing counts after the grader's fault
    if (const auto* progress = std::get_if<ProgressRecord>(&record)) OnProgress(run, *progress);
    if (const auto* facts = std::get_if<EpisodeFacts>(&record)) OnEpisode(run, *facts);
    if (const auto* end = std::get_if<LeaseEndRecord>(&record)) run.end = *end;
    const std::lock_guard lock(mutex_);
    scheduler_.Heartbeat(run.lease, run.attempt, clock_.Monotonic());
  }
  if (!run.fault.empty()) run.runner->Kill();
}

void Engine::OnProgress(LeaseRun& run, const ProgressRecord& record) {
  const std::lock_guard lock(mutex_);
  Live& live = live_.at(run.lease);
  live.episode = record.episode;
  live.step = record.step;
}

void Engine::OnEpisode(LeaseRun& run, const EpisodeFacts& facts) {
  if (facts.index < run.first || facts.index > run.last || run.recorded.contains(facts.index) ||
      facts.seed != (*run.context->seeds)[static_cast<size_t>(facts.index)]) {
    run.fault = absl::StrCat("the runner told of episode ", facts.index, " with seed ", facts.seed,
                             ", which the lease did not ask for");
    return;
  }
  absl::StatusOr<EpisodeRow> row = JudgedRow(*run.context->track, facts);
  if (!row.ok()) {
    run.fault = std::string(row.status().message());
    return;
  }
  row->evaluation = run.context->evaluation;
  row->lease = run.lease;
  row->attempt = run.attempt;
  run.recorded.insert(facts.index);
  Later([row = *std::move(row)](Writer& writer) -> absl::Status {
    absl::StatusOr<Recorded> recorded = writer.RecordEpisode(row);
    if (!recorded.ok()) return recorded.status();
    if (!recorded->differs.empty()) {
      spdlog::warn("evaluation {}, episode {}: played again, and came out otherwise (policy not "
                   "repeatable)", row.evaluation, row.index);
    }
    return absl::OkStatus();
  });
}

void Engine::CheckDeadlines() {
  std::vector<Overdue> overdue;
  {
    const std::lock_guard lock(mutex_);
    overdue = scheduler_.OverdueAt(clock_.Monotonic());
  }
  for (const Overdue& late : overdue) {
    LeaseRun& run = running_.at(late.lease);
    if (run.fault.empty()) run.fault = late.why;
    run.runner->Kill();
  }
}

void Engine::Reap() {
  for (auto it = running_.begin(); it != running_.end();) {
    LeaseRun& run = it->second;
    if (!run.runner->finished()) {
      ++it;
      continue;
    }
    Listen(run);  // what came between the last reading and the end
    EndOf(run);
    RemoveFolder(run.work_dir);
    it = running_.erase(it);
  }
}

void Engine::EndOf(LeaseRun& run) {
  if (run.fault.empty() && !run.end.has_value()) {
    spdlog::error("lease {}: the runner wrote: {}", run.lease, run.runner->stderr_tail());
    run.fault = absl::StrCat("the runner ended (wait status ", run.runner->wait_status(),
                             ") without its last record; its last words: ",
                             LastLineOf(run.runner->stderr_tail()));
  } else if (run.fault.empty() && !run.end->ok) {
    run.fault = run.end->detail;
  } else if (run.fault.empty() &&
             static_cast<int64_t>(run.recorded.size()) != run.last - run.first + 1) {
    run.fault = absl::StrCat("the runner said done after ", run.recorded.size(), " of ",
                             run.last - run.first + 1, " episodes");
  }
  if (!run.fault.empty()) return Fault(run, run.fault);
  Later([lease = run.lease, attempt = run.attempt,
         output = CanonicalJson(OutputJson(*run.end)), who = owner_](Writer& writer) {
    return writer.FinishLease(lease, attempt, output, who);
  });
  const std::lock_guard lock(mutex_);
  live_.erase(run.lease);
  const Verdict verdict = scheduler_.Finished(run.lease, run.attempt);
  if (verdict.kind == Verdict::Kind::kEvaluationEnds) to_settle_.insert(verdict.evaluation);
}

void Engine::Fault(const LeaseRun& run, const std::string& why) {
  spdlog::error("lease {}, attempt {}: fault of the grader: {}", run.lease, run.attempt, why);
  Verdict verdict;
  {
    const std::lock_guard lock(mutex_);
    live_.erase(run.lease);
    verdict = scheduler_.Faulted(run.lease, run.attempt, clock_.Monotonic());
  }
  if (verdict.kind == Verdict::Kind::kReplay) {
    Later([lease = run.lease, attempt = run.attempt, why, who = owner_](Writer& writer) {
      return writer.ReturnLease(lease, attempt, /*fault=*/true, who, why);
    });
  } else if (verdict.kind == Verdict::Kind::kGiveUp) {
    GiveUp(verdict, run.lease, why);
  }
}

void Engine::GiveUp(const Verdict& verdict, int64_t failed, const std::string& why) {
  const std::string reason =
      absl::StrCat("lease ", failed, " failed ", options_.config.scheduler.max_replays + 1,
                   " times by the grader's fault, the last time: ", why);
  std::vector<int64_t> others = verdict.pending;
  others.insert(others.end(), verdict.running.begin(), verdict.running.end());
  Later([=, evaluation = verdict.evaluation, who = owner_](Writer& writer) {
    absl::Status status = writer.EndLease(failed, LeaseState::kFailed, /*fault=*/true, who, why);
    for (const int64_t lease : others) {
      status.Update(writer.EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who,
                                    absl::StrCat("lease ", failed, " could not be played")));
    }
    status.Update(
        writer.EndEvaluation(evaluation, EvaluationState::kGraderError, reason, "", who));
    return status;
  });
  KillLeases(verdict.running);
  contexts_.erase(verdict.evaluation);
}

// Several at once, as each may take its runner up to a second. Their slots are free in the
// scheduler already, but nothing starts before this returns, as the loop is here.
void Engine::KillLeases(const std::vector<int64_t>& leases) {
  {
    std::vector<std::jthread> killers;
    for (const int64_t lease : leases) {
      killers.emplace_back([runner = running_.at(lease).runner.get()] { runner->Kill(); });
    }
  }
  for (const int64_t lease : leases) {
    RemoveFolder(running_.at(lease).work_dir);
    running_.erase(lease);
    const std::lock_guard lock(mutex_);
    live_.erase(lease);
  }
}

absl::Status Engine::Shutdown() {
  std::vector<int64_t> leases;
  for (const auto& [lease, run] : running_) {
    leases.push_back(lease);
    Later([id = lease, attempt = run.attempt, who = owner_](Writer& writer) {
      return writer.ReturnLease(id, attempt, /*fault=*/false, who, "the daemon stopped");
    });
  }
  KillLeases(leases);
  flush_after_ = absl::ZeroDuration();
  return Flush();
}

}  // namespace myograde::server
