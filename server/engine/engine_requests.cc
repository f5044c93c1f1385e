// Requests that change the store; concurrent requests are written together.

#include "protocol/base/status_macros.h"
#include "server/engine/engine.h"

namespace myograde::server {
namespace {

// Makes the submitter the first member of the submission's team, where that is asked for.
absl::Status Found(Transaction& writer, const NewSubmission& submission) {
  if (!submission.founding.has_value()) return absl::OkStatus();
  const Founding& founding = *submission.founding;
  if (founding.needed) return writer.teams.Found(submission.team, founding.person, founding.most);
  const absl::Status status = writer.Part([&](Transaction& part) {
    return part.teams.Found(submission.team, founding.person, founding.most);
  });
  return absl::IsFailedPrecondition(status) ? absl::OkStatus() : status;
}

}  // namespace

absl::Status Engine::Change(StoreChange change, absl::Duration timeout,
                            std::function<absl::Status()> effect) {
  return commands_.Call(
      [this, change = std::move(change), effect = std::move(effect)](CommandQueue::Answer answer) {
        core_.Ask({change, effect, std::move(answer)});
      },
      timeout);
}

absl::Status Engine::DrainNode(const std::string& node, const std::string& why,
                               const std::string& who, absl::Duration timeout) {
  return Change([=](Transaction& writer) { return writer.leases.DrainNode(node, why, who); },
                timeout, [this, node, why] { return core_.executor().Drain(node, why); });
}

absl::Status Engine::AdmitNode(const std::string& node, const std::string& who,
                               absl::Duration timeout) {
  return Change([=](Transaction& writer) { return writer.leases.AdmitNode(node, who); }, timeout,
                [this, node] { return core_.executor().Admit(node); });
}

absl::StatusOr<bool> Engine::AddArtefact(const ArtefactRow& artefact, const NewUpload& upload,
                                         const UnsubmittedLimits& limits, absl::Duration timeout) {
  return Change<bool>(
      [artefact, upload, limits](Transaction& writer) -> absl::StatusOr<bool> {
        ASSIGN_OR_RETURN(const bool is_new, writer.content.AddArtefact(artefact));
        RETURN_IF_ERROR(writer.content.AddUpload(artefact, upload, limits));
        return is_new;
      },
      timeout);
}

absl::StatusOr<Accepted> Engine::Admit(std::function<absl::StatusOr<Accepted>(Transaction&)> add,
                                       absl::Duration timeout) {
  return Change<Accepted>(std::move(add), timeout, [this](const Accepted& accepted) {
    return accepted.is_new() ? core_.Enqueue(accepted.evaluation) : absl::OkStatus();
  });
}

absl::StatusOr<Accepted> Engine::Submit(const NewSubmission& submission,
                                        const AdmissionRules& rules, const std::string& who,
                                        absl::Duration timeout) {
  return Admit([this, submission, rules, who](Transaction& writer) {
    return writer.submissions.Once(who, submission.request_key, [&]() -> absl::StatusOr<Accepted> {
      // Files are removed on the loop's thread too, so those that are there now stay.
      RETURN_IF_ERROR(HasArtefactFiles(data_dir_, submission.artefact));
      RETURN_IF_ERROR(Found(writer, submission));
      return writer.submissions.Accept(submission, rules, who);
    });
  }, timeout);
}

absl::StatusOr<bool> Engine::ChangeTeams(std::function<absl::StatusOr<bool>(Transaction&)> change,
                                         absl::Duration timeout) {
  return Change<bool>(std::move(change), timeout, [this](bool) {
    core_.FollowTeams();
    return absl::OkStatus();
  });
}

absl::StatusOr<Accepted> Engine::Rerun(const NewRerun& rerun, const std::string& who,
                                       bool organiser, const RerunLimits& limits,
                                       absl::Duration timeout) {
  return Admit(
      [this, rerun, who, organiser, limits](Transaction& writer) {
        return writer.submissions.Once(who, rerun.request_key, [&]() -> absl::StatusOr<Accepted> {
          RETURN_IF_ERROR(HasArtefactFiles(data_dir_, rerun.artefact));
          RETURN_IF_ERROR(writer.submissions.CheckReruns(rerun.submission, who, organiser, limits));
          return writer.evaluations.AddRerun(rerun, who);
        });
      },
      timeout);
}

absl::StatusOr<CancelReport> Engine::Cancel(const CancelOrder& order, absl::Duration timeout) {
  const auto report = std::make_shared<CancelReport>();
  RETURN_IF_ERROR(commands_.Call(
      [this, order, report](CommandQueue::Answer answer) {
        core_.Cancel(order, [report, answer](absl::StatusOr<CancelReport> done) {
          if (done.ok()) *report = *done;
          answer(done.status());
        });
      },
      timeout));
  return *report;
}

}  // namespace myograde::server
