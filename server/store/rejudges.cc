#include "server/store/rejudges.h"

#include <algorithm>
#include <map>
#include <set>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

using State = RejudgeProgress::State;

absl::Status Refused(const RejudgeRow& rejudge, const std::string& what) {
  return absl::FailedPreconditionError(absl::StrCat("rejudge ", rejudge.id, " ", what));
}

// A later one of the same board that is applied, or 0.
int64_t LaterApplied(const BoardState& board, const RejudgeRow& rejudge) {
  const auto& all = board.rejudges();
  const auto later = std::find_if(all.rbegin(), all.rend(), [&](const auto& entry) {
    const RejudgeRow& other = entry.second;
    return other.purpose == RejudgePurpose::kRules && other.board == rejudge.board &&
           other.last() == RejudgeEvent::kApplied &&
           other.events.back().id > rejudge.events.back().id;
  });
  return later == all.rend() ? 0 : later->first;
}

std::string Listing(const std::set<int64_t>& submissions) {
  return submissions.empty() ? "none" : absl::StrJoin(submissions, ", ");
}

// "" if a rejudge may be applied, else why not.
std::string WhyNotApplied(const RejudgeRow& rejudge, const RejudgeProgress& progress,
                          const std::set<int64_t>& without, const std::string& in_force) {
  if (rejudge.purpose == RejudgePurpose::kSeeds) {
    return "can't be applied: it plays further episodes for the statistics, and no rank follows from "
           "them";
  }
  if (progress.state == State::kApplied) return "is applied already";
  if (!progress.complete) {
    const int64_t open = progress.missing + progress.items - progress.ended;
    return progress.state == State::kDropped
               ? absl::StrCat("can't be applied again: it was dropped, and ",
                              open + progress.cancelled, " of its ",
                              progress.missing + progress.items,
                              " results are missing; create a new one")
               : absl::StrCat("can't be applied yet: ", open, " of its ",
                              progress.missing + progress.items, " results are not computed; wait "
                              "until its state is \"ready\"");
  }
  if (in_force != rejudge.from_config) {
    return absl::StrCat("can't be applied: it starts from config ", rejudge.from_config.substr(0, 12),
                        ", and the board's config is now ", in_force.substr(0, 12),
                        "; create a new one");
  }
  std::set<int64_t> lacking;
  for (const EvaluationRow& item : progress.without_result) lacking.insert(item.submission);
  if (without == lacking) return "";
  return absl::StrCat("has no result of these submissions: ", Listing(lacking),
                      "; to apply it without them, name exactly these (they are off the board "
                      "then), and ",
                      Listing(without), " named");
}

// The results that an application makes those of the board: of each submission the first
// repetition.
nlohmann::json ResultsOf(const std::vector<EvaluationRow>& evaluations) {
  nlohmann::json results = nlohmann::json::array();
  for (const EvaluationRow& row : evaluations) {
    if (row.repetition != 1) continue;
    results.push_back({{"submission", row.submission},
                       {"evaluation", row.id},
                       {"state", EnumName(row.state)},
                       {"results", TextOrNull(row.results_hash)}});
  }
  return results;
}

}  // namespace

absl::StatusOr<RejudgeRow> Rejudges::Find(int64_t id) const {
  const RejudgeRow* rejudge = Board().Rejudge(id);
  return rejudge == nullptr ? absl::StatusOr<RejudgeRow>(NoSuch("rejudge", id)) : *rejudge;
}

absl::StatusOr<RejudgeProgress> Rejudges::CountProgress(const RejudgeRow& rejudge) const {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> items, Evaluations(context_).OfRejudge(rejudge.id));
  RejudgeProgress progress;
  std::set<int64_t> submissions;
  for (const EvaluationRow& item : items) {
    submissions.insert(item.submission);
    ++progress.items;
    ++(item.method == RejudgeMethod::kFacts ? progress.facts : progress.play);
    const int64_t episodes = item.last - item.first + 1;
    progress.episodes += episodes;
    progress.episodes_done += item.state == EvaluationState::kDone
                                  ? episodes
                                  : Episodes(context_).Counts(item.id).done;
    progress.ended += IsFinal(item.state);
    progress.cancelled += item.state == EvaluationState::kCancelled;
    const bool has_result = item.state != EvaluationState::kGraderError &&
                            item.state != EvaluationState::kCancelled;
    if (item.repetition == 1 && !has_result) progress.without_result.push_back(item);
  }
  for (const EvaluationRow& candidate : MissingItems(rejudge)) {
    submissions.insert(candidate.submission);
    ++progress.missing;
  }
  progress.submissions = std::ssize(submissions);
  const bool dropped = rejudge.last() == RejudgeEvent::kDropped;
  progress.complete = progress.missing == 0 && progress.ended == progress.items &&
                      !(dropped && progress.cancelled > 0);
  progress.state = rejudge.last() == RejudgeEvent::kApplied ? State::kApplied
                   : dropped                                ? State::kDropped
                   : progress.complete                      ? State::kReady
                                                            : State::kComputing;
  return progress;
}

std::vector<EvaluationRow> Rejudges::MissingItems(const RejudgeRow& rejudge) const {
  // Where the config stays, what was accepted after it was applied has its result under it.
  int64_t latest = INT64_MAX;
  for (const RejudgeEventRow& event : rejudge.events) {
    const bool applied = event.event == RejudgeEvent::kApplied;
    if (applied && rejudge.from_config == rejudge.to_config) latest = std::min(latest, event.at);
  }
  std::set<std::pair<int64_t, int64_t>> there;
  Statement select(db_, "SELECT submission, repetition FROM evaluation WHERE rejudge = ?",
                   rejudge.id);
  while (select.executeStep()) {
    there.emplace(select.getColumn(0).getInt64(), select.getColumn(1).getInt64());
  }
  const bool all = rejudge.purpose == RejudgePurpose::kRules;
  const auto in_force = Board().InForce(rejudge.from_config, {.ignored_rejudge = rejudge.id});
  std::vector<EvaluationRow> missing;
  for (int64_t repetition = 1; repetition <= rejudge.repeats; ++repetition) {
    for (const auto& [submission, result] : in_force) {
      const AcceptedSubmission& accepted = Board().submissions().at(submission);
      if (accepted.board != rejudge.board || accepted.at > latest) continue;
      if (!all && !rejudge.submissions.contains(submission)) continue;
      if (there.contains({submission, repetition})) continue;
      missing.push_back({.submission = submission,
                         .kind = EvaluationKind::kRejudge,
                         .config = rejudge.to_config,
                         .seeds = rejudge.seeds,
                         .rejudge = rejudge.id,
                         .repetition = repetition,
                         .source = result->evaluation});
    }
  }
  return missing;
}

absl::StatusOr<std::map<int64_t, std::vector<RepeatRow>>> Rejudges::ListUnrepeatable(
    int64_t rejudge) const {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> items, Evaluations(context_).OfRejudge(rejudge));
  std::map<int64_t, std::vector<RepeatRow>> found;
  const EvaluationRow* first = nullptr;
  std::vector<EpisodeRow> episodes;  // of `first`, once they are needed
  for (const EvaluationRow& item : items) {
    ASSIGN_OR_RETURN(std::vector<RepeatRow> repeats, Episodes(context_).Repeats(item.id));
    for (const RepeatRow& repeat : repeats) {
      found[item.submission].push_back({repeat.index, repeat.differs, item.repetition});
    }
    if (item.results_hash.empty()) continue;  // it has none, or not yet
    if (first == nullptr || first->submission != item.submission) {
      first = &item;
      episodes.clear();
      continue;
    }
    if (item.results_hash == first->results_hash) continue;
    if (episodes.empty()) {
      ASSIGN_OR_RETURN(episodes, Episodes(context_).Of(first->id));
    }
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> others, Episodes(context_).Of(item.id));
    for (size_t i = 0; i < std::min(episodes.size(), others.size()); ++i) {
      std::vector<std::string> differs = DifferencesBetween(episodes[i], others[i]);
      if (differs.empty()) continue;
      found[item.submission].push_back({others[i].index, std::move(differs), item.repetition});
    }
  }
  return found;
}

absl::StatusOr<RejudgeEventRow> Rejudges::AddEvent(const RejudgeRow& rejudge, RejudgeEvent event,
                                                   const std::string& why, const SignDocument& sign,
                                                   const std::string& who) {
  const bool applied = event == RejudgeEvent::kApplied;
  nlohmann::json document = RejudgeKeys(rejudge);
  document.update({{"format", 1},
                   {"document", "rejudge"},
                   {"event", EnumName(event)},
                   {"at", TimeText(now_ms_)},
                   {"who", who},
                   {"reason", why},
                   {"seeds", rejudge.seeds}});
  if (!rejudge.submissions.empty()) document["submissions"] = rejudge.submissions;
  if (applied) {
    ASSIGN_OR_RETURN(const std::vector<EvaluationRow> evaluations,
                     Evaluations(context_).OfRejudge(rejudge.id));
    document["results"] = ResultsOf(evaluations);
  }
  const std::string text = CanonicalJson(document);
  ASSIGN_OR_RETURN(const std::string signature, sign(text));
  NewAct act{.kind = kRejudgeAct,
             .who = who,
             .content = {{"event", EnumName(event)},
                         {"rejudge", rejudge.id},
                         {"document_sha256", Sha256Hex(text)},
                         {"signature", signature}}};
  // Until a rejudge is applied, participants see nothing of it: its document is committed to, and
  // told when it is applied.
  if (applied) {
    for (const char* key : {"purpose", "from_config", "to_config", "phase", "track", "profile"}) {
      act.content[key] = document[key];
    }
  }
  (applied ? act.content : act.beside)["document"] = std::move(document);
  Append(act);
  return Board().Rejudge(rejudge.id)->events.back();
}

absl::StatusOr<RejudgeRow> Rejudges::Add(const NewRejudge& rejudge, const SignDocument& sign,
                                         const std::string& who) {
  Content content(context_);
  RETURN_IF_ERROR(content.AddText(kConfigs, rejudge.from_config, rejudge.from_config_json));
  RETURN_IF_ERROR(content.AddText(kConfigs, rejudge.to_config, rejudge.to_config_json));
  RETURN_IF_ERROR(content.AddText(kSeedLists, rejudge.seeds, rejudge.seeds_json));
  const auto& earlier = Board().rejudges();
  RejudgeRow row = static_cast<const RejudgeRow&>(rejudge);
  row.id = earlier.empty() ? 1 : earlier.rbegin()->first + 1;
  RETURN_IF_ERROR(AddEvent(row, RejudgeEvent::kCreated, rejudge.why, sign, who).status());
  return *Board().Rejudge(row.id);
}

absl::StatusOr<Accepted> Rejudges::AddItem(const NewRejudgeItem& item, const std::string& who) {
  ASSIGN_OR_RETURN(const RejudgeRow rejudge, Find(item.rejudge));
  if (AnyRow(db_, R"(SELECT 1
      FROM evaluation WHERE rejudge = ? AND submission = ? AND repetition = ?)",
             item.rejudge, item.submission, item.repetition)) {
    return Accepted{.submission = item.submission, .repeated = true};
  }
  if (rejudge.last() == RejudgeEvent::kDropped) return Refused(rejudge, "was dropped");
  const EvaluationState state = item.result.state;
  if (state == EvaluationState::kDone || state == EvaluationState::kFailed) {
    return AddJudged(item, who);
  }
  ASSIGN_OR_RETURN(Accepted added, Evaluations(context_).Add(item, item.blocks, who));
  if (state != EvaluationState::kGraderError) return added;
  RETURN_IF_ERROR(
      Evaluations(context_).EndWithBlocks(added.evaluation, state, item.result.reason, who));
  added.blocks.clear();
  return added;
}

absl::StatusOr<Accepted> Rejudges::AddJudged(const NewRejudgeItem& item, const std::string& who) {
  const EvaluationResult& result = item.result;
  const std::string state(EnumName(result.state));
  if (Run(db_, R"(INSERT INTO evaluation (submission, kind, first, last, state, reason, grader_json,
      results_hash, created_at, started_at, finished_at, config, seeds, rejudge, repetition, source,
      method) SELECT submission, 'rejudge', first, last, ?1, ?2, grader_json, ?3, ?4, ?4, ?4, ?5, ?6,
      ?10, ?11, id, 'facts'
      FROM evaluation WHERE id = ?7 AND submission = ?8 AND last - first + 1 = ?9)",
          state, result.reason, result.results_hash, now_ms_, item.config, item.seeds, item.source,
          item.submission, std::ssize(item.episodes), item.rejudge, item.repetition) != 1) {
    return absl::InternalError(absl::StrCat("evaluation ", item.source, " is not of submission ",
                                            item.submission, ", or has other episodes"));
  }
  const int64_t evaluation = db_.getLastInsertRowid();
  const std::string why = absl::StrCat("judged anew from the facts of evaluation ", item.source);
  RETURN_IF_ERROR(Audit("evaluation", evaluation, "", state, who, why));
  Run(db_, R"(INSERT INTO block (evaluation, first, last, state, attempt, finished_at, output_json)
      SELECT ?, first, last, 'done', 1, ?, output_json
      FROM block WHERE evaluation = ? ORDER BY first)",
      evaluation, now_ms_, item.source);
  Run(db_, R"(INSERT INTO transition (at, entity, entity_id, from_state, to_state, who, why)
      SELECT ?, 'block', id, '', 'done', ?, ? FROM block WHERE evaluation = ? ORDER BY id)",
      now_ms_, who, why, evaluation);
  Statement episode(db_, R"(INSERT INTO episode SELECT ?1, p.idx, l.id,
      1, p.seed, ?2, ?3, p.facts_json, ?4, ?5, p.log
      FROM episode AS p JOIN block AS l ON l.evaluation = ?1 AND p.idx BETWEEN l.first AND l.last
      WHERE p.evaluation = ?6 AND p.idx = ?7)");
  for (const EpisodeRow& judged : item.episodes) {
    SQLite::bind(episode, evaluation, std::string(OutcomeName(judged.outcome)),
                 std::string(judged.reason.name()), judged.metrics_json, now_ms_, item.source,
                 judged.index);
    if (episode.exec() != 1) {
      return DamagedRow({"episode", absl::StrCat(item.source, "/", judged.index),
                         "it is missing, or no block holds it"});
    }
    episode.reset();
  }
  Run(db_, R"(INSERT INTO episode_details (evaluation, idx, details_json)
      SELECT ?, idx, details_json FROM episode_details WHERE evaluation = ? ORDER BY idx)",
      evaluation, item.source);
  if (result.state == EvaluationState::kDone) {
    RETURN_IF_ERROR(Episodes(context_).SetStanding(evaluation, result.aggregate));
  }
  Evaluations(context_).AppendGraded(evaluation, who);
  return Accepted{.submission = item.submission, .evaluation = evaluation};
}

absl::StatusOr<RejudgeDone> Rejudges::End(bool apply, const RejudgeAct& act,
                                          const SignDocument& sign, const std::string& who) {
  ASSIGN_OR_RETURN(const RejudgeRow rejudge, Find(act.rejudge));
  RejudgeDone done;
  done.config_before = Board().ConfigAt(rejudge.board);
  // A board without submissions has still the one that it began with.
  if (done.config_before.empty()) done.config_before = rejudge.from_config;
  done.config_after = apply ? rejudge.to_config : done.config_before;
  if (apply) {
    ASSIGN_OR_RETURN(const RejudgeProgress progress, CountProgress(rejudge));
    const std::string why = WhyNotApplied(rejudge, progress, act.without, done.config_before);
    if (!why.empty()) return Refused(rejudge, why);
  } else {
    RETURN_IF_ERROR(Drop(rejudge, who, done));
  }
  const RejudgeEvent event = apply ? RejudgeEvent::kApplied : RejudgeEvent::kDropped;
  ASSIGN_OR_RETURN(done.event, AddEvent(rejudge, event, act.why, sign, who));
  if (done.config_after == done.config_before) return done;
  RETURN_IF_ERROR(
      Journal(context_)
          .SetBoardConfig(
              {.board = rejudge.board, .config = done.config_after, .rejudge = rejudge.id}, who)
          .status());
  return done;
}

absl::Status Rejudges::Drop(const RejudgeRow& rejudge, const std::string& who, RejudgeDone& done) {
  const RejudgeEventRow& last = rejudge.events.back();
  if (last.event == RejudgeEvent::kDropped) return Refused(rejudge, "was dropped already");
  const bool applied = last.event == RejudgeEvent::kApplied;
  if (const int64_t later = applied ? LaterApplied(Board(), rejudge) : 0; later != 0) {
    return Refused(rejudge, absl::StrCat("can't be dropped before rejudge ", later,
                                         ", which was applied after it to the same board"));
  }
  // If the config files have changed the board's config since, it stays.
  if (applied && done.config_before == rejudge.to_config) done.config_after = rejudge.from_config;
  if (applied && rejudge.from_config != rejudge.to_config) {
    done.stay = std::ranges::count_if(Board().submissions(), [&](const auto& one) {
      return one.second.config == rejudge.to_config &&
             one.second.board.phase == rejudge.board.phase && one.second.at >= last.at;
    });
  }
  done.cancelled = AllValues<int64_t>(db_, R"(SELECT id FROM evaluation
      WHERE rejudge = ? AND finished_at IS NULL ORDER BY id)",
                                      rejudge.id);
  for (const int64_t evaluation : done.cancelled) {
    RETURN_IF_ERROR(Evaluations(context_).EndWithBlocks(
        evaluation, EvaluationState::kCancelled,
        absl::StrCat("rejudge ", rejudge.id, " was dropped"), who));
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
